"""What all kinds of resources share: pages of lists, and tags.

A page's token says where the next page begins; it is no secret, and a changed one is a fault of the request.
"""

import base64
import json
from collections.abc import Collection, Iterable
from itertools import islice
from typing import TypeVar, cast

from pydantic import JsonValue

from specs.base import Spec
from specs.errors import DocumentError
from specs.field_types import Arn, FilteredPage, Page, TagKey, TagMap

T = TypeVar("T")
Place = tuple[int | str, ...]


# A token holds the place of the last thing on its page in the order of the list, and nothing of who made it: it works
# anywhere and at any time, whatever was made or removed since.
def wanted_values(request: FilteredPage, names: Collection[str]) -> dict[str, frozenset[str]]:
    """Returns the name that a list request filters by, with its values, of which a thing must have one.

    Raises:
        DocumentError: It filters by another name than the call knows, or by several (docs/reference/robomaker.md,
            section 9).
    """
    filters = request.filters or ()
    asked = {each.name or "" for each in filters}
    for name in sorted(asked - set(names)):
        raise _refused("filters.name", repr(name), f"one of {', '.join(names)}")
    if len(asked) > 1:
        raise _refused(
            "filters.name", repr(" and ".join(sorted(asked))), "filters of one name, of which any one suffices"
        )
    return {name: frozenset(value for each in filters for value in each.values or ()) for name in asked}


def page_size(request: Page, most: int) -> int:
    """Returns how many things a page has at most.

    Raises:
        DocumentError: The request wants fewer than 1, or more than a page of this list has.
    """
    if request.maxResults is None:
        return most
    if not 1 <= request.maxResults <= most:
        raise _refused("maxResults", str(request.maxResults), f"1 to {most}")
    return request.maxResults


def place_after(request: Page, of: str, form: tuple[type, ...]) -> Place | None:
    """Returns the place after which the page begins; None for the first page.

    Args:
        request: The List call's.
        of: What is listed: the token of another list is none.
        form: The types of a place.

    Raises:
        DocumentError: The token is none that a page of this list gave.
    """
    if request.nextToken is None:
        return None
    try:
        found = cast("JsonValue", json.loads(base64.b64decode(request.nextToken, altchars=b"-_", validate=True)))
    except (ValueError, RecursionError):  # no base64, no text, no JSON
        found = None
    if not isinstance(found, list) or found[:1] != [of] or tuple(type(each) for each in found[1:]) != form:
        raise _refused("nextToken", repr(request.nextToken[:80]), f"the nextToken of a page of {of}")
    return tuple(cast("list[int | str]", found[1:]))


def page_of(found: Iterable[tuple[Place, T]], size: int, of: str) -> tuple[tuple[T, ...], str | None]:
    """Returns the first things that are found, and the token of the next page if there is more.

    Args:
        found: All from where the page begins on, each with its place.
        size: Of the page.
        of: What is listed.
    """
    page = list(islice(found, size + 1))
    more = len(page) > size
    return tuple(each for _, each in page[:size]), _token(page[size - 1][0], of) if more else None


def _token(place: Place, of: str) -> str:
    return base64.urlsafe_b64encode(json.dumps([of, *place], separators=(",", ":")).encode()).decode()


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError.of(path, value, allowed, source="simyard")


class ListTagsForResourceRequest(Spec):
    """Asks for the tags of a resource."""

    resourceArn: Arn


class ListTagsForResourceResponse(Spec):
    """The tags of a resource."""

    tags: TagMap | None = None


class TagResourceRequest(Spec):
    """Asks for tags to be added to a resource; one of the same key is overwritten."""

    resourceArn: Arn
    tags: TagMap


class TagResourceResponse(Spec):
    """Says nothing."""


class UntagResourceRequest(Spec):
    """Asks for tags to be removed from a resource."""

    resourceArn: Arn
    tagKeys: tuple[TagKey, ...]


class UntagResourceResponse(Spec):
    """Says nothing."""
