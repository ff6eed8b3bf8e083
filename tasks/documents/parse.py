"""Makes a document of plain data, or lists all that is wrong with it in plain words.

A key that is certainly misspelt is read as its author meant it, so that what lies below it is checked, too.
"""

import copy
import json
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any, TypeVar, cast, get_args

from annotated_types import Ge, Le
from pydantic import BaseModel, JsonValue, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from specs import field_types
from specs.base import Fault
from specs.errors import DocumentError
from specs.rules import RULE
from specs.template.interior import NAMES_PATTERN
from tasks.documents.shape_text import (
    KeyPlace,
    Place,
    is_tag,
    key_places,
    known_keys,
    known_place,
    list_text,
    meant_key,
    meant_text,
    missing_text,
    models_at,
    number_text,
    object_text,
    same_word,
    unknown_key_text,
)

_Object = dict[str, JsonValue]


CORRECTABLE = ("extra_forbidden", "tuple_type")
"""The types of errors that may hide others: unknown keys, and what should be a list."""

MAX_SHOWN = 60
_TYPES = {
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "dict_type": "keys and values",
}
_NUMBERS = {"float_type": "a number", "int_type": "a whole number"}
_PERCENT = 100
MAX_FAULTS = 100
"""More than a person reads; the rest is counted."""
_MOST_TOLD = 5_000
"""Errors beyond which they are only counted: to tell each costs as much as to read the document a thousand times."""
_ROUNDS = 10
_MOST_CORRECTED = 300
"""Errors beyond which nothing is corrected: no person wrote that, and each round reads the whole document again."""
Model = TypeVar("Model", bound=BaseModel)


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
    if kind in _NUMBERS:
        allowed = number_text(value, error["loc"], _NUMBERS[kind])
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
    metres = any((field.title or "").endswith("(m)") for field in fields)
    return f"from {lows[0]:,} to {highs[0]:,}{_metres(value) if metres else _percent(value, highs[0])}"


def _below(context: dict[str, Any], value: object) -> str:
    return f"less than {context['lt']:g}{_percent(value, context['lt'])}"


def _metres(value: object) -> str:
    """Returns how a length is written of which somebody wrote the centimetres; empty for anything else."""
    if isinstance(value, int | float) and 1 < value <= _PERCENT:
        return f" metres; write {value / 100:g} for {value:g} cm"
    return " metres"


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
    "greater_than_equal": _says("{ge} or more"),
    "less_than_equal": _says("{le} or less"),
    "less_than": _below,
    "greater_than": _says("more than {gt}"),
}


def parse(model: type[Model], data: JsonValue, source: str = "document") -> Model:
    """Returns the data as a document.

    Args:
        model: What the document is.
        data: What was read.
        source: Where it was read from, for the message.

    Raises:
        DocumentError: With every fault: where, what stands there, what may.
    """
    faults = {fault.path: fault for fault in islice(_empty_keys(data), MAX_FAULTS)}
    more = 0
    try:
        document = model.model_validate(data)
    except ValidationError as exc:
        if exc.error_count() > _MOST_TOLD:
            raise DocumentError.of(
                "document", f"{exc.error_count():,} faults", f"a {model.__name__}", source=source
            ) from None
        faults, more = _with_errors(_all_errors(exc, model, data), model, faults)
    else:
        if not faults:
            return document
    rest = [Fault(path="document", value=f"{more:,} faults more", allowed="correct these first")] if more else []
    raise DocumentError([*faults.values(), *rest], source)


def _all_errors(exc: ValidationError, model: type[BaseModel], data: JsonValue) -> list[ErrorDetails]:
    """Returns what is wrong with data, also below keys in wrong capitals, on the wrong level, or without their list.

    Pydantic does not look below what it does not know. Each round corrects that as far as it is certain; the last one
    tells what else is wrong, and all of them tell what they corrected.
    """
    hiding: list[ErrorDetails] = []
    errors = exc.errors(include_url=False)
    for _ in range(_ROUNDS):
        corrected = with_corrections(data, model, errors) if len(errors) <= _MOST_CORRECTED else None
        if corrected is None:
            break
        hiding += [error for error in errors if error["type"] in CORRECTABLE]
        data = corrected
        try:
            model.model_validate(data)
        except ValidationError as again:
            errors = again.errors(include_url=False)
        else:
            return hiding
    return [*hiding, *errors]


def _with_errors(
    errors: list[ErrorDetails], model: type[BaseModel], faults: dict[str, Fault]
) -> tuple[dict[str, Fault], int]:
    """Returns the faults with pydantic's errors added, and how many are left out as nobody would read them."""
    unknown = [error["loc"] for error in errors if error["type"] == "extra_forbidden"]
    # A needed key that is misspelt is there, under another name, and that is said.
    meant = {(*place[:-1], meant_key(model, place)[0]) for place in unknown[:_MOST_CORRECTED]}
    errors = [error for error in errors if not only_repeats(error)]
    errors = [error for error in errors if error["type"] != "missing" or error["loc"] not in meant]
    found = dict(faults)
    for number, error in enumerate(errors):
        if len(found) >= MAX_FAULTS:
            return found, len(errors) - number
        fault = fault_of(error, model)
        # What is empty is said once: that the field wants text, too, is no news.
        if fault.path not in faults:
            found[str(fault)] = fault
    return found, 0


def _empty_keys(data: JsonValue) -> Iterator[Fault]:
    """Yields keys with nothing behind them: an empty ``gate:`` must not pass for no gate."""
    pending: list[tuple[Place, JsonValue]] = [((), data)]
    while pending:
        place, value = pending.pop()
        if value is None:
            yield Fault(
                path=path_of(place), value="nothing", allowed="a value, indented below the key; or leave the key out"
            )
        elif isinstance(value, list):
            pending.extend(((*place, number), item) for number, item in reversed(list(enumerate(value))))
        elif isinstance(value, dict):
            pending.extend(((*place, key), item) for key, item in reversed(list(value.items())))
