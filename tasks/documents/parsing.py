"""Plain data made into a document, or a list of all that is wrong with it."""

from collections.abc import Iterator
from typing import TypeVar

from pydantic import BaseModel, JsonValue, ValidationError

from specs.base import Fault
from specs.errors import DocumentError
from tasks.documents.wording import Place, fault_of, path_of

MAX_FAULTS = 100
"""More than a person reads; the rest is counted."""

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
    empty = list(_empty_keys(data))
    try:
        document = model.model_validate(data)
    except ValidationError as exc:
        faults = [*empty, *_faults(exc, model, skip={fault.path for fault in empty})]
        raise DocumentError(_first(faults), source) from exc
    if empty:
        raise DocumentError(_first(empty), source)
    return document


def _faults(exc: ValidationError, model: type[BaseModel], skip: set[str]) -> Iterator[Fault]:
    seen = set[str]()
    for error in exc.errors(include_url=False):
        fault = fault_of(error, model)
        if fault is not None and fault.path not in skip and str(fault) not in seen:
            seen.add(str(fault))
            yield fault


def _empty_keys(data: JsonValue) -> Iterator[Fault]:
    """Yields keys with nothing behind them: an empty ``gate:`` must not pass for no gate."""
    pending: list[tuple[Place, JsonValue]] = [((), data)]
    while pending:
        place, value = pending.pop()
        if value is None:
            yield Fault(path=path_of(place), value="nothing", allowed="a value; or leave the key out")
        elif isinstance(value, list):
            pending.extend(((*place, number), item) for number, item in reversed(list(enumerate(value))))
        elif isinstance(value, dict):
            pending.extend(((*place, key), item) for key, item in reversed(list(value.items())))


def _first(faults: list[Fault]) -> list[Fault]:
    if len(faults) <= MAX_FAULTS:
        return faults
    rest = Fault(path="document", value=f"{len(faults) - MAX_FAULTS:,} faults more", allowed="correct these first")
    return [*faults[:MAX_FAULTS], rest]
