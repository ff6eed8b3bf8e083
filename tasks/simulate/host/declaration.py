"""Reads what a bundle declares in a YAML file: all that is wrong with it is told at once.

Nothing else in it is run or followed: a file of few bytes that would take hours to read is refused.
"""

from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from specs.base import Spec
from tasks.simulate.refusal import RobotRefused

_MOST_BYTES = 64 << 10
_MOST_LEVELS = 16
_SHOWN = 80
# What PyYAML raises of a value that is not what its tag or its form says.
_NO_VALUE = (ValueError, OverflowError, LookupError, AttributeError, TypeError)
S = TypeVar("S", bound=Spec)


def read_declaration(path: Path, name: str, form: type[S]) -> S | None:
    """Returns what a file declares; None if there is no such file.

    Args:
        path: The file.
        name: Of it, as its author knows it.
        form: What it may say.

    Raises:
        RobotRefused: The file is no YAML, or says what it must not.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as exc:
        raise RobotRefused(f"{name}: cannot be read: {exc.strerror}") from exc
    if len(text) > _MOST_BYTES:
        raise RobotRefused(f"{name}: more than {_MOST_BYTES} bytes: a declaration is a page")
    try:
        return form.model_validate(_loaded(text, name))
    except ValidationError as exc:
        faults = (
            f"{'.'.join(map(str, each['loc']))}: {_short(each['input'])}: {_words(each, form)}" for each in exc.errors()
        )
        raise RobotRefused("; ".join(f"{name}: {fault.removeprefix(': ')}" for fault in faults)) from exc


def _words(error: ErrorDetails, form: type[BaseModel]) -> str:
    """Returns what is wrong with a value; for a key that nobody knows, the keys that may stand there."""
    if error["type"] != "extra_forbidden":
        return error["msg"]
    forms = [form]
    for step in error["loc"][:-1]:  # the index of a list, and the kind of a drive, lead to the same forms
        inner = [found for one in forms if (field := one.model_fields.get(str(step))) for found in _forms(field)]
        forms = inner or forms
    return f"an unknown key; known are {', '.join(dict.fromkeys(key for one in forms for key in one.model_fields))}"


def _forms(field: FieldInfo) -> list[type[BaseModel]]:
    """Returns the mappings that a field may hold, in lists and choices, too."""
    open_types: list[Any] = [field.annotation]
    found: list[type[BaseModel]] = []
    while open_types:
        each = open_types.pop()
        if isinstance(each, type) and issubclass(each, BaseModel):
            found.append(each)
        open_types += get_args(each)
    return found


def _loaded(text: bytes, name: str) -> object:
    """Returns the file's mapping.

    Raises:
        RobotRefused: It is no YAML, or so deep, or with parts that stand for others, that few bytes would take hours.
    """
    try:
        _require_plain(text, name)
        found = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, *_NO_VALUE) as exc:
        raise RobotRefused(f"{name}: no YAML: {' '.join(str(exc).split())[:300]}") from exc
    return {} if found is None else found


def _require_plain(text: bytes, name: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise RobotRefused(f"{name}: an alias (*name): write out what it stands for")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_LEVELS:
            raise RobotRefused(f"{name}: more than {_MOST_LEVELS} levels: a declaration has three")


def _short(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}..."
