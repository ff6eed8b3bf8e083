"""The base of every document, its form as a JSON schema, its digest, and the faults that are found in one."""

import hashlib
import inspect
import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Protocol, Self, cast

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, JsonValue
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

Schema = dict[str, Any]

_ABBREVIATIONS = frozenset({"arn", "gpu", "iam", "id", "ip", "s3", "ui", "url", "vpc"})
_WORD = re.compile(r"[A-Z]+(?![a-z])\d*|[A-Za-z][a-z]*\d*|\d+")
_ATTRIBUTE = re.compile(r"^ {4}((?!_)\w+): (.*(?:\n {5,}\S.*)*)", re.MULTILINE)
_KINDS = {
    "null": "None",
    "string": "Text",
    "boolean": "Yes or no",
    "integer": "Whole number",
    "number": "Number",
    "array": "List",
    "object": "Keys and values",
}


class _Told(Protocol):
    title: str | None
    description: str | None


# What a document may say stays the same. Every field gets a title in words and its description: that of its
# ``Field``, or of the ``Attributes:`` in its class's docstring, which are read only when somebody asks for a schema.
# The rest is what that form needs: it knows ``anyOf`` but not ``oneOf``, names the members of a choice by their
# titles, and would offer "None" beside every text that may be left out. It must be told the order, too, which
# PostgreSQL does not keep.
def words(name: str) -> str:
    """Returns a field's or a class's name as words: ``worldCount`` is "World count", ``streamUI`` "Stream UI"."""
    found = [word.lower() for word in _WORD.findall(name)]
    first, *others = [word.upper() if word in _ABBREVIATIONS else word for word in found] or [name]
    return " ".join([first[:1].upper() + first[1:], *others])


def attribute_docs(model: type) -> dict[str, str]:
    """Returns what the docstrings of a class and of those that it inherits from say of their attributes."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        _, _, attributes = inspect.cleandoc(vars(base).get("__doc__") or "").partition("Attributes:\n")
        found |= {name: " ".join(text.split()) for name, text in _ATTRIBUTE.findall(attributes)}
    return found


def as_form(schema: Schema, model: type, fields: Mapping[str, _Told]) -> None:
    """Puts titles, descriptions, order and simpler choices into the JSON schema of a class.

    Args:
        schema: Of the class, as pydantic makes it; changed in place, and not changed by a second time.
        model: The class.
        fields: What its fields say of themselves.
    """
    schema["title"] = words(model.__name__)
    schema["description"] = inspect.cleandoc(model.__doc__ or "").partition("\n\nAttributes:")[0]
    told = attribute_docs(model)
    for position, (name, below) in enumerate(cast("dict[str, Schema]", schema.get("properties", {})).items()):
        below["title"] = fields[name].title or words(name)
        below["position"] = position
        _choose(below)
        description = fields[name].description or told.get(name)
        if description:
            below["description"] = f"{description} {_bounds(below)}".strip()


def _bounds(schema: Schema) -> str:
    """Returns the bounds of a number in words, which the form would not show."""
    numbers = [one for one in (schema, *schema.get("anyOf", ())) if one.get("type") in {"integer", "number"}]
    if not numbers:
        return ""
    (number,) = numbers
    low, above = number.get("minimum"), number.get("exclusiveMinimum")
    high, below = number.get("maximum"), number.get("exclusiveMaximum")
    least = f"from {low:,}" if low is not None else f"above {above:,}" if above is not None else ""
    most = f"to {high:,}" if high is not None else f"below {below:,}" if below is not None else ""
    if least.startswith("from") and most.startswith("below"):
        most = f"to {most}"
    found = ", ".join((least, most)) if least.startswith("above") and most else f"{least} {most}".strip()
    return f"{found[:1].upper()}{found[1:]}." if found else ""


def _choose(schema: Schema) -> None:
    """Makes a choice, here or in the items of a list, one that the form knows."""
    if "items" in schema:
        _choose(schema["items"])
    if "oneOf" in schema:
        schema["anyOf"] = schema.pop("oneOf")
        schema.pop("discriminator", None)
    options = cast("Sequence[Schema]", schema.get("anyOf", ()))
    for option in options:
        _choose(option)
        if "type" in option:
            option.setdefault("title", option.get("const") or _KINDS[option["type"]])
    nested = [option for option in options if "anyOf" in option]
    if nested:
        schema["anyOf"] = [below for option in options for below in option.get("anyOf", [option])]
    elif len(options) == 2 and options[1].get("type") == "null":
        _leave_out(schema, options[0])


def _leave_out(schema: Schema, option: Schema) -> None:
    """Offers no "None" beside what may simply be left out; Prefect's server takes a null there all the same."""
    if "type" not in option or "enum" in option or "const" in option or schema.get("default") is not None:
        return
    del schema["anyOf"]
    schema.pop("default", None)
    for key, value in option.items():
        schema.setdefault(key, value)


def canonical_document(model: BaseModel) -> dict[str, JsonValue]:
    """Returns a document as plain JSON data: defaults spelled out, absent fields left out."""
    return model.model_dump(mode="json", exclude_none=True)


def without_absent(value: JsonValue) -> JsonValue:
    """Returns JSON data as `canonical_document` has it: fields that are null left out, however deep."""
    if isinstance(value, dict):
        return {name: without_absent(each) for name, each in value.items() if each is not None}
    return [without_absent(each) for each in value] if isinstance(value, list) else value


def canonical_json(document: Mapping[str, JsonValue]) -> bytes:
    """Returns JSON bytes with sorted keys and no spaces (UTF-8).

    Raises:
        ValueError: For NaN or infinity, which JSON has no words for.
    """
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode()


def digest(model: BaseModel) -> str:
    """Returns the SHA-256 of a document's canonical JSON, lower-case hex."""
    return hashlib.sha256(canonical_json(canonical_document(model))).hexdigest()


_set_attribute = object.__setattr__  # what `model_construct` sets attributes of frozen documents with


@cache
def _all_names(model: type[BaseModel]) -> set[str]:
    """Returns the names of all fields; documents share the set, for nobody adds to that of a frozen one."""
    return set(model.model_fields)


class Spec(BaseModel):
    """A frozen document that refuses keys it does not know.

    Fields of documents that RoboMaker defined carry its camelCase names to the letter, in Python too
    (docs/decisions/0002); fields of Simyard's own data are snake_case with the unit as suffix.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")

    @classmethod
    def unchecked(cls, fields: dict[str, object]) -> Self:
        """Returns a document of fields that its own code made right: all of them, of their very types.

        A check of each would take several times as long as all the rest. Data from outside goes through
        ``model_validate``. The dictionary becomes the document's own.
        """
        document = cls.__new__(cls)
        _set_attribute(document, "__dict__", fields)
        _set_attribute(document, "__pydantic_fields_set__", _all_names(cls))
        _set_attribute(document, "__pydantic_extra__", None)
        _set_attribute(document, "__pydantic_private__", None)
        return document

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Returns the schema with everything that a form in the browser shows of each field."""
        schema = handler(core_schema)
        as_form(handler.resolve_ref_schema(schema), cls, cls.model_fields)
        return schema


class Fault(Spec):
    """One thing wrong with a document.

    Attributes:
        path: Where, from the top of the document, such as ``worldGeneration.worldCount.floorplanCount``.
        value: What stands there, shortened for printing.
        allowed: What may stand there instead.
    """

    path: str
    value: str
    allowed: str

    def __str__(self) -> str:
        """Returns the fault as one line for a person."""
        return f"{self.path}: {self.value}: {self.allowed}"
