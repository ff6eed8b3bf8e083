"""What differs between two requests that came with one client request token."""

from collections.abc import Iterator
from itertools import islice

from pydantic import JsonValue

_SHOWN = 3
_VALUE_CHARACTERS = 40
_NOTHING = "nothing"


def changes_text(before: JsonValue, after: JsonValue) -> str:
    """Returns the first fields that differ, each with both values, in one line."""
    found = list(islice(_changes(before, after, ""), _SHOWN + 1))
    return ", ".join(found[:_SHOWN]) + (", ..." if len(found) > _SHOWN else "")


def _changes(before: JsonValue, after: JsonValue, path: str) -> Iterator[str]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted(before.keys() | after.keys()):
            yield from _changes(before.get(key), after.get(key), f"{path}.{key}" if path else key)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for place, (old, new) in enumerate(zip(before, after, strict=True)):
            yield from _changes(old, new, f"{path}[{place}]")
    elif before != after:
        yield f"{path} was {_value(before)} and is {_value(after)}"


def _value(value: JsonValue) -> str:
    if value is None:
        return _NOTHING
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = repr(value)
    return text if len(text) <= _VALUE_CHARACTERS else f"{text[:_VALUE_CHARACTERS]}..."
