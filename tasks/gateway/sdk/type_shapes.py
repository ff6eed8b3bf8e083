"""The types of documents as shapes of an SDK's model: names, kinds, bounds, patterns, words."""

from collections.abc import Callable, Mapping
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Le, MaxLen, MinLen
from pydantic import StringConstraints
from pydantic.fields import FieldInfo

from specs.base import Spec
from specs.field_types import Timestamp
from specs.interface.shapes import aliases

Shape = dict[str, Any]
_SCALARS = {str: "string", bool: "boolean", int: "integer", float: "float"}


class ShapeTable:
    """The shapes of some documents by name; asking for one adds it with all below it.

    Args:
        structure: Returns the shape of a document class, and may ask for those of its fields.
    """

    def __init__(self, structure: Callable[["ShapeTable", type[Spec]], Shape]) -> None:
        self.shapes: dict[str, Shape] = {}
        self._structure = structure

    def name_of(self, hint: Any, place: str) -> str:  # noqa: ANN401 - a type
        """Returns the name of the shape of a type.

        Args:
            hint: As a field has it; that it may be left out is not part of its shape.
            place: What a shape is called that has no name of its own in specs, such as ``ListFleetsResponseFleets``.
        """
        bare = _present(hint)
        if bare == Timestamp:
            self.shapes["Timestamp"] = {"type": "timestamp"}
            return "Timestamp"
        if isinstance(bare, type) and issubclass(bare, Spec):
            if bare.__name__ not in self.shapes:
                self.shapes[bare.__name__] = {}  # a shape may have itself below it
                self.shapes[bare.__name__] = self._structure(self, bare)
            return bare.__name__
        name = _names().get(_key(bare), place)
        if name not in self.shapes:
            self.shapes[name] = self._shape(_taken_apart(bare), name)
        return name

    def _shape(self, type_: "_Type", name: str) -> Shape:
        if get_origin(type_.kind) is Literal:
            return {"type": "string", "enum": list(get_args(type_.kind))}
        if get_origin(type_.kind) is tuple:
            item = self.name_of(get_args(type_.kind)[0], f"{name}Item")
            return {"type": "list", "member": {"shape": item}, **type_.bounds}
        if get_origin(type_.kind) is dict:
            key, value = get_args(type_.kind)
            sides = {"key": self.name_of(key, f"{name}Key"), "value": self.name_of(value, f"{name}Value")}
            return {"type": "map", **{side: {"shape": each} for side, each in sides.items()}, **type_.bounds}
        return {"type": _SCALARS[type_.kind], **type_.bounds}


class _Type(NamedTuple):
    kind: Any
    bounds: Mapping[str, Any]


def _present(hint: Any) -> Any:  # noqa: ANN401 - a type
    """Returns a type without None."""
    if get_origin(hint) in {Union, UnionType}:
        (hint,) = (each for each in get_args(hint) if each is not type(None))
    return hint


def _taken_apart(hint: Any) -> _Type:  # noqa: ANN401 - a type
    if get_origin(hint) is not Annotated:
        return _Type(hint, {})
    kind, *rules = get_args(hint)
    bounds: Shape = {}
    for rule in rules:
        for each in rule.metadata if isinstance(rule, FieldInfo) else (rule,):
            bounds |= _bounds(each)
    return _Type(kind, bounds)


def _bounds(rule: object) -> Shape:
    match rule:
        case StringConstraints():
            pattern = str(rule.pattern).removeprefix("^(?:").removesuffix(")$")
            return {"min": rule.min_length, "max": rule.max_length, "pattern": pattern}
        case Ge():
            return {"min": rule.ge}
        case Le():
            return {"max": rule.le}
        case MinLen():
            return {"min": rule.min_length}
        case MaxLen():
            return {"max": rule.max_length}
        case _:  # a rule of RoboMaker's prose: no client knew it, and the server says more about it
            return {}


@cache
def _names() -> Mapping[str, str]:
    names: dict[str, str] = {}
    for name, hint in aliases().items():
        names.setdefault(_key(hint), name)
    return names


def _key(hint: Any) -> str:  # noqa: ANN401 - a type
    # Equal types are one shape; what they are made of is not always hashable.
    return repr(hint)


def hints_of(shape: type[Spec]) -> Mapping[str, Any]:
    """Returns the types of a document's fields by name."""
    hints = get_type_hints(shape, include_extras=True)
    return {name: hints[name] for name in shape.model_fields}
