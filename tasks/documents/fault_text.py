"""Says pydantic's errors in plain words: where, what stands there, what may stand there instead."""

import json
import re
from collections.abc import Callable
from typing import Any, get_args

from annotated_types import Ge, Le
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from specs import field_types
from specs.base import Fault
from specs.rules import RULE
from specs.template.interior import NAMES_PATTERN
from tasks.documents.key_places import Place, is_tag, models_at
from tasks.documents.shape_text import (
    list_text,
    meant_text,
    missing_text,
    number_text,
    object_text,
    same_word,
    unknown_key_text,
)

MAX_SHOWN = 60

_PATTERNS = {
    field_types.ARN_PATTERN: "an ARN, arn:...",
    field_types.NAME_PATTERN: "letters, digits, underscores and hyphens",
    field_types.COMMAND_PATTERN: "letters, digits, underscores, hyphens and dots",
    field_types.TAG_PATTERN: "letters, digits, spaces and _ . - / + = :",
    field_types.TOKEN_PATTERN: "letters, digits and _ - =",
    field_types.BUCKET_PATTERN: "a bucket's name: lower-case letters, digits, dots and hyphens",
    field_types.ROLE_PATTERN: "a role, arn:aws:iam::<account>:role/<name>",
    field_types.VERSION_PATTERN: 'a version number such as "3", or $LATEST',
    field_types.NUMBER_PATTERN: 'a version number such as "3"; $LATEST cannot be deployed',
    field_types.VARIABLE_PATTERN: "a variable's name: capital letters, digits and underscores, no digit first",
    field_types.GENERIC_PATTERN: "text in one line",
    field_types.PLAIN_NAME_PATTERN: "a name: letters, digits, underscores and hyphens, at most 64",
    field_types.REFERENCE_PATTERN: "a name (letters, digits, underscores and hyphens, at most 64) or an ARN",
    field_types.WORLD_REFERENCE_PATTERN: "a world as <generation>/<world>, or an ARN",
    NAMES_PATTERN: "letters, digits, spaces, underscores and hyphens",
}
_TYPES = {
    "int_type": "a whole number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "dict_type": "keys and values",
}


def only_repeats(error: ErrorDetails) -> bool:
    """Returns whether an error says no more than others do.

    Pydantic counts the valid items of a tuple, so invalid ones, which have their own errors, also make it too short.
    """
    return error["type"] == "too_short" and len(error["input"]) >= error.get("ctx", {})["min_length"]


def fault_of(error: ErrorDetails, model: type[BaseModel]) -> Fault:
    """Returns an error as a fault.

    Args:
        error: One entry of `pydantic.ValidationError.errors`.
        model: What the document is, to tell the keys and bounds that are known.
    """
    kind, value, context = error["type"], error["input"], error.get("ctx", {})
    path = path_of(error["loc"])
    if kind == "missing":
        return Fault(path=path, value="missing", allowed=missing_text(model, error["loc"]))
    if kind == "extra_forbidden":
        return Fault(path=path, value="unknown key", allowed=unknown_key_text(model, error["loc"]))
    words = _WORDS.get(kind)
    allowed = words(context, value) if words else _TYPES.get(kind, error["msg"])
    if kind in ("model_type", "model_attributes_type"):
        allowed = object_text(model, error["loc"], value)
    if kind in ("tuple_type", "list_type"):
        allowed = list_text(model, error["loc"], value)
    if kind in ("greater_than_equal", "less_than_equal"):
        allowed = _bounds(model, error["loc"], value) or allowed
    if kind == RULE:
        allowed = _rule_text(error["msg"], value)
    return Fault(path=path, value=short_json(value), allowed=allowed)


def path_of(place: Place) -> str:
    """Returns a place as ``key.key[0]``; ``document`` for the whole."""
    path = ""
    for step in place:
        if isinstance(step, int):
            path += f"[{step}]"
        elif not is_tag(step):
            path += f".{_printable(step)}"
    return path.removeprefix(".") or "document"


def short_json(value: object) -> str:
    """Returns a value as JSON, shortened."""
    text = _printable(json.dumps(value, ensure_ascii=False, default=str))
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 4]} ..."


def _bounds(model: type[BaseModel], place: Place, value: object) -> str | None:
    """Returns both bounds of a number where only one was broken."""
    keys = [number for number, step in enumerate(place) if isinstance(step, str) and not is_tag(step)]
    parents = models_at(model, place[: keys[-1]]) if keys else []
    fields = [one.model_fields[str(place[keys[-1]])] for one in parents if place[keys[-1]] in one.model_fields]
    marks = [mark for field in fields for mark in (*field.metadata, *_metadata(field.annotation))]
    lows = [mark.ge for mark in marks if isinstance(mark, Ge)]
    highs = [mark.le for mark in marks if isinstance(mark, Le)]
    if not len(lows) == len(highs) == 1:
        return None
    return f"from {lows[0]:,} to {highs[0]:,}{_percent(value, highs[0])}"


_PERCENT = 100


def _below(context: dict[str, Any], value: object) -> str:
    return f"less than {context['lt']:g}{_percent(value, context['lt'])}"


def _percent(value: object, bound: object) -> str:
    """Returns how a share is written of which somebody wrote the percents; empty for anything else."""
    if not isinstance(value, int | float) or not isinstance(bound, int | float):
        return ""
    return f"; write {value / 100:g} for {value:g} %" if bound <= 1 < value <= _PERCENT else ""


def _metadata(annotation: Any) -> list[object]:  # noqa: ANN401 - any type expression
    inner = [mark for part in get_args(annotation) for mark in _metadata(part)]
    marks: list[object] = list(getattr(annotation, "__metadata__", ()))
    nested = [mark for field in marks if isinstance(field, FieldInfo) for mark in field.metadata]
    return [*inner, *marks, *nested]


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else ascii(character)[1:-1] for character in text)


def _rule_text(rule: str, value: object) -> str:
    """Returns what a rule allows, and which of its words is meant by one in other capitals."""
    meant = same_word(value, re.findall(r"[A-Z][\w.]*\w", rule)) if isinstance(value, str) else ""
    return f'did you mean "{meant}"? {rule}' if meant and meant != value else rule


def _text(context: dict[str, Any], value: object) -> str:  # noqa: ARG001 - one signature for all
    quotable = isinstance(value, int | float) and not isinstance(value, bool)
    return f'text; write "{value}" in quotes' if quotable else "text"


def _one_of(context: dict[str, Any], value: object) -> str:
    members = re.findall(r"'([^']*)'", str(context["expected"]))
    if not isinstance(value, str):
        quotable = str(value) in members
        return f'text; write "{value}" in quotes' if quotable else f"one of {', '.join(members)}"
    return f"{meant_text(value, members)}one of {', '.join(members)}" if len(members) > 1 else members[0]


def _pattern(context: dict[str, Any], value: object) -> str:  # noqa: ARG001 - one signature for all
    pattern = str(context["pattern"]).removeprefix("^(?:").removesuffix(")$")
    return _PATTERNS.get(pattern, f"text that matches {pattern}")


def _says(template: str) -> Callable[[dict[str, Any], object], str]:
    return lambda context, _: template.format(**context)


def _count(bound: str, key: str) -> Callable[[dict[str, Any], object], str]:
    return lambda context, _: f"{bound} {context[key]} item{'' if context[key] == 1 else 's'}"


_WORDS: dict[str, Callable[[dict[str, Any], object], str]] = {
    "string_type": _text,
    "literal_error": _one_of,
    "string_pattern_mismatch": _pattern,
    "string_too_short": _says("at least {min_length} characters"),
    "string_too_long": _says("at most {max_length} characters"),
    "too_short": _count("at least", "min_length"),
    "too_long": _count("at most", "max_length"),
    "float_type": lambda _, value: number_text(value),
    "greater_than_equal": _says("{ge} or more"),
    "less_than_equal": _says("{le} or less"),
    "less_than": _below,
    "greater_than": _says("more than {gt}"),
}
