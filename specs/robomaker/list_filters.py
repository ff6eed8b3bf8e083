"""The filters that all List calls share; up to three of the same name are alternatives."""

from collections.abc import Collection

from specs.base import Fault
from specs.errors import DocumentError
from specs.field_types import FilteredPage


def wanted_values(request: FilteredPage, names: Collection[str]) -> dict[str, frozenset[str]]:
    """Returns the name that a list request filters by, with its values, of which a thing must have one.

    Raises:
        DocumentError: It filters by another name than the call knows, or by several (docs/reference/robomaker.md,
            section 9).
    """
    filters = request.filters or ()
    asked = {each.name or "" for each in filters}
    for name in sorted(asked - set(names)):
        raise _refused(name, f"one of {', '.join(names)}" if names else "nothing: this list has no filters")
    if len(asked) > 1:
        raise _refused(" and ".join(sorted(asked)), "filters of one name, of which any one suffices")
    return {name: frozenset(value for each in filters for value in each.values or ()) for name in asked}


def _refused(name: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="filters.name", value=repr(name), allowed=allowed)], source="simyard")
