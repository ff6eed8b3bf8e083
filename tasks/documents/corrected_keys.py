"""A document as its author meant it, as far as that is certain, so that what lies below a wrong key is checked, too."""

import copy
from collections.abc import Iterable
from typing import cast

from pydantic import BaseModel, JsonValue
from pydantic_core import ErrorDetails

from tasks.documents.key_places import KeyPlace, Place, is_tag, key_places, known_keys, known_place
from tasks.documents.shape_text import same_word

_Object = dict[str, JsonValue]


CORRECTABLE = ("extra_forbidden", "tuple_type")
"""The types of errors that may hide others: unknown keys, and what should be a list."""


def with_corrections(data: JsonValue, model: type[BaseModel], errors: Iterable[ErrorDetails]) -> JsonValue | None:
    """Returns a copy of the data with keys in the right capitals and on the right level, and single objects in lists.

    Args:
        data: What was read.
        model: What the document is.
        errors: What is wrong with it.

    Returns:
        The copy; None where no correction is certain.
    """
    hiding = [error for error in errors if error["type"] in CORRECTABLE]
    found = copy.deepcopy(data) if hiding else data
    done = [
        _listed(found, model, error["loc"]) if error["type"] == "tuple_type" else _correct(found, model, error["loc"])
        for error in hiding
    ]
    return found if any(done) else None


def _listed(data: JsonValue, model: type[BaseModel], place: Place) -> bool:
    """Puts an object into a list of its own, where a list of such objects belongs."""
    parent, key = _object_at(data, place[:-1]), str(place[-1])
    value = parent.get(key) if parent is not None else None
    known = known_keys(model, place)
    if parent is None or not isinstance(value, dict) or not any(same_word(each, known) for each in value):
        return False
    parent[key] = [value]
    return True


def _correct(data: JsonValue, model: type[BaseModel], place: Place) -> bool:
    parent, key = _object_at(data, place[:-1]), str(place[-1])
    if parent is None or key not in parent:
        return False
    meant = same_word(key, known_keys(model, place[:-1]))
    if meant:
        return _renamed(parent, key, meant)
    here = known_place(model, place[:-1])
    below = [each for each in key_places(model).get(key.lower(), ()) if each.keys[: len(here)] == here]
    return len(below) == 1 and _moved(parent, key, below[0], len(here))


def _renamed(parent: _Object, key: str, meant: str) -> bool:
    if meant in parent:
        return False
    parent[meant] = parent.pop(key)
    return True


def _moved(parent: _Object, key: str, place: KeyPlace, first: int) -> bool:
    """Moves a value down to where its key belongs; nothing is moved where something stands already."""
    inside: JsonValue = parent
    for step, many in zip(place.keys[first:-1], place.lists[first:-1], strict=True):
        if not isinstance(inside, dict):
            return False
        inside = inside.setdefault(step, [{}] if many else {})
        if many:
            inside = inside[0] if isinstance(inside, list) and len(inside) == 1 else None
    if not isinstance(inside, dict) or place.keys[-1] in inside:
        return False
    inside[place.keys[-1]] = parent.pop(key)
    return True


def _object_at(data: JsonValue, place: Place) -> _Object | None:
    found: JsonValue = data
    for step in place:
        if isinstance(found, dict) and isinstance(step, str):
            found = found if is_tag(step) else found.get(step)
        elif isinstance(found, list) and isinstance(step, int) and step < len(found):
            found = found[step]
        else:
            return None
    return cast("_Object", found) if isinstance(found, dict) else None
