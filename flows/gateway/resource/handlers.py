"""The calls about resources that are no jobs, and about tags, in one table."""

from flows.gateway.gateway import Handlers
from flows.gateway.resource import applications, fleets, tags, templates, worlds

HANDLERS: Handlers = {
    **applications.HANDLERS,
    **templates.HANDLERS,
    **worlds.HANDLERS,
    **fleets.HANDLERS,
    **tags.HANDLERS,
}
