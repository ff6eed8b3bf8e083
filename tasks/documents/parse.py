"""Makes a document of plain data, or lists all that is wrong with it."""

from collections.abc import Iterator
from itertools import islice
from typing import TypeVar

from pydantic import BaseModel, JsonValue, ValidationError
from pydantic_core import ErrorDetails

from specs.base import Fault
from specs.errors import DocumentError
from tasks.documents.corrected_keys import CORRECTABLE, with_corrections
from tasks.documents.fault_text import fault_of, only_repeats, path_of
from tasks.documents.key_places import Place

MAX_FAULTS = 100
"""More than a person reads; the rest is counted."""

_MOST_TOLD = 5_000
"""Errors beyond which they are only counted: to tell each costs as much as to read the document a thousand times."""
_ROUNDS = 10
_MOST_CORRECTED = 300
"""Errors beyond which nothing is corrected: no person wrote that, and each round reads the whole document again."""

Model = TypeVar("Model", bound=BaseModel)


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
            fault = Fault(path="document", value=f"{exc.error_count():,} faults", allowed=f"a {model.__name__}")
            raise DocumentError([fault], source) from None
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
    errors = [error for error in errors if not only_repeats(error)]
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
