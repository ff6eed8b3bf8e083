"""The ARNs in requests and answers, brought from RoboMaker's form to Simyard's own and back."""

from collections.abc import Callable, Mapping
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, cast, get_args, get_origin, get_type_hints

from pydantic import JsonValue, StringConstraints

from specs.base import Spec
from specs.field_types import ARN_PATTERN

Places = Mapping[str, "Places"]
"""Fields with ARNs, and those with ARNs somewhere below; what a field that is an ARN has below is nothing."""
_ARN_TEXT = f"^(?:{ARN_PATTERN})$"


def with_arns(document: Mapping[str, Any], shape: type[Spec], change: Callable[[str], str]) -> dict[str, JsonValue]:
    """Returns the data of a document with all its ARNs changed.

    Args:
        document: The data; it may be wrong in any way.
        shape: What it is to be; its types say where ARNs are, so that texts that look like one stay.
        change: Returns the new form of an ARN.
    """
    return _changed(document, _places(shape), change)


def _changed(value: Any, places: Places, change: Callable[[str], str]) -> Any:  # noqa: ANN401 - JSON
    if isinstance(value, str):
        return value if places else change(value)
    if isinstance(value, list):
        return [_changed(item, places, change) for item in cast("list[Any]", value)]
    if isinstance(value, Mapping) and places:
        found = dict(cast("Mapping[str, Any]", value))
        for name in places.keys() & found.keys():
            found[name] = _changed(found[name], places[name], change)
        return found
    return value


@cache
def _places(shape: type[Spec]) -> Places:
    hints = get_type_hints(shape, include_extras=True)
    found = {name: _below(hint) for name, hint in hints.items() if name in shape.model_fields}
    return {name: places for name, places in found.items() if places is not None}


def _below(hint: Any) -> Places | None:  # noqa: ANN401 - a type
    """Returns the places of ARNs in what has a type: none for an ARN itself, None where there cannot be any."""
    if isinstance(hint, type) and issubclass(hint, Spec):
        return _places(hint) or None
    if get_origin(hint) is Annotated:
        kind, *rules = get_args(hint)
        if any(isinstance(rule, StringConstraints) and rule.pattern == _ARN_TEXT for rule in rules):
            return {}
        return _below(kind)
    if get_origin(hint) in {Union, UnionType, tuple}:
        inner = [places for each in get_args(hint) if (places := _below(each)) is not None]
        return inner[0] if inner else None
    return None
