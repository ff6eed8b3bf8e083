"""Rules of documents that no field can state alone, and unions whose member is chosen by the shape of the data."""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self, cast

from pydantic import (
    Discriminator,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    Tag,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import no_info_after_validator_function

from specs.base import Spec

RULE = "rule"
"""The error type of everything that is raised here; its message says what is allowed, in plain words."""

Location = tuple[str | int, ...]


# Pydantic skips a model's own validators as soon as one of its fields is wrong, so a person would fix one fault and
# meet the next. A `Ruled` document looks at the raw data instead, and raises everything at once.
class Finding(NamedTuple):
    """One broken rule.

    Attributes:
        loc: Keys and indices from the document that has the rule to the place.
        value: What stands there.
        allowed: What may stand there instead, in plain words.
    """

    loc: Location
    value: object
    allowed: str


class Ruled(Spec):
    """A document with rules of its own; subclasses say which in `findings`."""

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields the rules that raw data (a mapping) breaks; it may be wrong in any other way too."""
        raise NotImplementedError

    @model_validator(mode="wrap")
    @classmethod
    def _check(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(data, Mapping):
            return handler(data)
        errors = [_line(finding) for finding in cls.findings(data)]
        if not errors:
            return handler(data)
        try:
            handler(data)
        except ValidationError as exc:
            # What a rule says of an unknown key is more than that it is one.
            told = [error.get("loc") for error in errors]
            others = [
                each for each in repeated(exc, ()) if each["type"] != "extra_forbidden" or each.get("loc") not in told
            ]
            errors = [*others, *errors]
        raise ValidationError.from_exception_data(cls.__name__, errors)


def broken(allowed: str) -> PydanticCustomError:
    """Returns the error that a validator raises when a value breaks a rule; the text says what is allowed."""
    return PydanticCustomError(RULE, cast("Any", allowed))


def repeated(exc: ValidationError, prefix: Location) -> list[InitErrorDetails]:
    """Returns the errors of a failed validation, to be raised again from a place further up the document."""
    return [_again(error, prefix) for error in exc.errors(include_url=False)]


def part(data: object, key: str) -> object:
    """Returns what raw data (a mapping or a document) has under a key, or None."""
    if isinstance(data, Mapping):
        return cast("Mapping[str, object]", data).get(key)
    return getattr(data, key, None) if isinstance(data, Spec) else None


def items(data: object) -> Sequence[object]:
    """Returns the items of a list in raw data; nothing when it is not a list."""
    return cast("Sequence[object]", data) if isinstance(data, list | tuple) else ()


@dataclass(frozen=True)
class Within:
    """Bounds of a whole number that only RoboMaker's prose states, told in its words and in the JSON schema."""

    low: int
    high: int
    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:  # noqa: ANN401
        """Returns the schema of the number with the bounds as a rule."""
        return no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(self, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Returns the JSON schema of the number with the bounds, for forms."""
        return {**handler(core_schema), "minimum": self.low, "maximum": self.high}

    def _check(self, value: int) -> int:
        if self.low <= value <= self.high:
            return value
        raise broken(f"from {self.low:,} to {self.high:,} {self.unit}")


@dataclass(frozen=True)
class JsonOf:
    """Says of a text that it is a document as JSON, so that its faults are told with the keys of that document."""

    model: type[Spec]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:  # noqa: ANN401
        """Returns the schema of the text, which must hold the document."""
        return no_info_after_validator_function(self._check, handler(source))

    def _check(self, value: str) -> str:
        self.model.model_validate(value)
        return value


def distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Returns the values, all different.

    Raises:
        PydanticCustomError: Naming what occurs twice.
    """
    twice = [value for number, value in enumerate(values) if value in values[:number]]
    if twice:
        raise broken(f"each value once; {twice[0]!r} occurs more than once")
    return values


def nearest_name(text: str, known: Iterable[str], alike: float = 0.6) -> str:
    """Returns the known name that a text is most like, whatever its capitals; empty if it is like none.

    Args:
        text: The name, perhaps misspelled.
        known: The names that there are.
        alike: How much alike they must be, 0-1, as difflib counts.
    """
    lowered = {one.lower(): one for one in known}
    close = difflib.get_close_matches(text.lower(), list(lowered), n=1, cutoff=alike)
    return lowered[close[0]] if close else ""


def meant(text: str, known: Iterable[str]) -> str:
    """Returns ``did you mean "..."? `` with the known name that a text is most like; empty if it is like none."""
    found = nearest_name(text, known)
    return f'did you mean "{found}"? ' if found else ""


def _line(finding: Finding) -> InitErrorDetails:
    return InitErrorDetails(type=broken(finding.allowed), loc=finding.loc, input=finding.value)


def _again(error: ErrorDetails, prefix: Location) -> InitErrorDetails:
    # A custom error cannot be raised again by its name, as pydantic's own can.
    kind = broken(error["msg"]) if error["type"] == RULE else error["type"]
    return InitErrorDetails(type=kind, loc=(*prefix, *error["loc"]), input=error["input"], ctx=error.get("ctx", {}))


Sign = str | type | tuple[type, ...] | frozenset[str]


def member(name: str) -> Tag:
    """Returns the tag of a union's member; the brackets tell it from a key of the document."""
    return Tag(f"<{name}>")


def by_shape(allowed: str, **members: Sign) -> Discriminator:
    """Returns a discriminator that chooses a union's member by how the data looks.

    Args:
        allowed: What may stand here, in plain words, for data that looks like no member.
        members: For each member, its sign: a key that only it has, the Python types of its JSON data, or
            the only texts that it may be.
    """

    def choose(data: Any) -> str | None:  # noqa: ANN401 - raw data
        names = (name for name, sign in members.items() if _looks_like(data, name, sign))
        return next((f"<{name}>" for name in names), None)

    return Discriminator(choose, custom_error_type=RULE, custom_error_message=cast("Any", allowed))


def _looks_like(data: object, name: str, sign: Sign) -> bool:
    if isinstance(data, Spec):
        return type(data).__name__ == name
    if isinstance(sign, str):
        return isinstance(data, dict) and sign in data
    if isinstance(sign, frozenset):
        return isinstance(data, str) and data in sign
    return isinstance(data, sign) and not isinstance(data, bool)
