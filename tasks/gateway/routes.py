"""Which operation a request is for; from the path on the wire, whose encoded slashes belong to an ARN."""

from collections.abc import Mapping
from typing import NamedTuple

from specs.interface.operations import OPERATIONS, TAGS, Operation
from tasks.gateway.messages import HttpRequest

_BEFORE_ARN = TAGS.partition("{")[0]
_ROUTES: Mapping[tuple[str, str], Operation] = {(each.method, each.path): each for each in OPERATIONS.values()}


class Route(NamedTuple):
    """Where a request leads.

    Attributes:
        operation: None if there is none of that method and path.
        place: The part of the path that names a resource, still percent-encoded; empty for most operations.
    """

    operation: Operation | None
    place: str = ""


def route(request: HttpRequest) -> Route:
    """Returns the operation of a request, and what its path names."""
    if request.raw_path.startswith(_BEFORE_ARN):
        return Route(_ROUTES.get((request.method, TAGS)), request.raw_path.removeprefix(_BEFORE_ARN))
    return Route(_ROUTES.get((request.method, request.raw_path)))
