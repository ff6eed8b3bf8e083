"""The table of all operations: what answers each of them, joined from the families."""

from flows.gateway import lists
from flows.gateway.gateway import Gateway, Handler, Handlers
from flows.gateway.jobs import handlers as jobs
from flows.gateway.resource import handlers as resource
from specs.base import Spec


def _with_tags(handler: Handler) -> Handler:
    """Returns a handler whose answers have tags, be there any or not: programs look into them without asking."""

    def answer(gateway: Gateway, request: Spec) -> Spec:
        found = handler(gateway, request)
        has_none = "tags" in type(found).model_fields and getattr(found, "tags", None) is None
        return found.model_copy(update={"tags": {}}) if has_none else found

    return answer


_FAMILIES: Handlers = {**jobs.HANDLERS, **lists.HANDLERS, **resource.HANDLERS}
HANDLERS: Handlers = {name: _with_tags(handler) for name, handler in _FAMILIES.items()}
