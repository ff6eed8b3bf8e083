"""The filters that all List calls share; several filters are alternatives."""

from collections.abc import Collection

from specs.base import Fault
from specs.errors import DocumentError
from specs.field_types import FilteredPage


def filter_pairs(request: FilteredPage, names: Collection[str]) -> list[tuple[str, str]]:
    """Returns the names and values that a list request filters by; an item is wanted if any of them fits.

    Raises:
        DocumentError: It filters by another name than the call knows.
    """
    pairs: list[tuple[str, str]] = []
    for each in request.filters or ():
        name = each.name or ""
        if name not in names:
            fault = Fault(path="filters.name", value=repr(name), allowed=f"one of {', '.join(names)}")
            raise DocumentError([fault], source="simyard")
        pairs += [(name, value) for value in each.values or ()]
    return pairs
