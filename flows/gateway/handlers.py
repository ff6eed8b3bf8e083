"""The table of all operations: what answers each of them, joined from the families."""

from flows.gateway import lists
from flows.gateway.gateway import Handlers
from flows.gateway.jobs import handlers as jobs
from flows.gateway.resource import handlers as resource

HANDLERS: Handlers = {**jobs.HANDLERS, **lists.HANDLERS, **resource.HANDLERS}
