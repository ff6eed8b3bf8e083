"""Reads a YAML or JSON file into plain data, without any surprise.

YAML is read as a notation for JSON: true, false, null, decimal numbers and text. Anchors, aliases, tags, several
documents in a file and keys that are not text are refused, and ``no``, ``010`` or ``2026-11-21`` are text.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError
from tasks.documents.yaml_data import YamlRefusedError, load_yaml

MAX_BYTES = 1 << 20
MAX_DEPTH = 40
_WANTED = "a YAML or JSON document of at most 1 MiB"


def read_document(path: Path) -> JsonValue:
    """Returns the data in a YAML or JSON file (``.json`` is read as JSON, everything else as YAML).

    Raises:
        DocumentError: When there is no such file, or it is not readable, or as for `decode_document`.
    """
    try:
        with path.open("rb") as file:
            body = file.read(MAX_BYTES + 1)
    except FileNotFoundError as exc:
        raise _refused("there is no such file", _WANTED, str(path)) from exc
    except IsADirectoryError as exc:
        raise _refused("it is a folder", _WANTED, str(path)) from exc
    except (OSError, ValueError) as exc:
        raise _refused(f"it cannot be read ({exc})", _WANTED, str(path)) from exc
    return decode_source_text(body, str(path))


def decode_source_text(body: bytes, source: str) -> JsonValue:
    """Returns the data in a YAML or JSON document.

    Args:
        body: The document.
        source: Where it comes from; JSON when that ends in ``.json``, else YAML.

    Raises:
        DocumentError: When it is longer than 1 MiB, not UTF-8 or malformed, or holds what plain data cannot (aliases,
            a key twice, NaN, more than 40 levels).
    """
    if len(body) > MAX_BYTES:
        raise _refused(f"more than {MAX_BYTES:,} bytes", _WANTED, source)
    try:
        text = body.decode("utf-8-sig")
        data = _load_json(text) if source.lower().endswith(".json") else load_yaml(text, MAX_DEPTH)
    except UnicodeDecodeError as exc:
        raise _refused(f"byte {exc.start} is not UTF-8", "text in UTF-8", source) from exc
    except (YamlRefusedError, _JsonRefusedError) as exc:
        raise DocumentError([Fault(path=exc.where, value=exc.what, allowed=exc.allowed)], source) from exc
    faults = list(_not_plain(data))
    if faults:
        raise DocumentError(faults, source)
    return data


class _JsonRefusedError(ValueError):
    """Text that is not JSON, or not plain JSON."""

    def __init__(self, where: str, what: str, allowed: str) -> None:
        super().__init__(what)
        self.where = where
        self.what = what
        self.allowed = allowed


def _refused(value: str, allowed: str, source: str) -> DocumentError:
    return DocumentError([Fault(path="file", value=value, allowed=allowed)], source)


def _load_json(text: str) -> JsonValue:
    try:
        return cast("JsonValue", json.loads(text, object_pairs_hook=_object, parse_constant=_constant))
    except json.JSONDecodeError as exc:
        raise _JsonRefusedError(f"line {exc.lineno}, column {exc.colno}", exc.msg, "JSON") from exc
    except RecursionError as exc:
        raise _JsonRefusedError("file", "too deeply nested", f"at most {MAX_DEPTH} levels") from exc
    except _JsonRefusedError:
        raise
    except ValueError as exc:
        raise _JsonRefusedError("file", "a number of thousands of digits", "shorter numbers") from exc


def _object(pairs: list[tuple[str, JsonValue]]) -> dict[str, JsonValue]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for number, key in enumerate(keys) if key in keys[:number])
        raise _JsonRefusedError(twice, "occurs twice in one object", "each key once")
    return found


def _constant(name: str) -> JsonValue:
    raise _JsonRefusedError("file", name, "numbers that are finite")


def _not_plain(data: JsonValue) -> Iterator[Fault]:
    """Yields what JSON notation can smuggle in: infinite numbers, text that is no Unicode, endless nesting."""
    pending: list[tuple[str, JsonValue, int]] = [("document", data, 1)]
    while pending:
        path, value, depth = pending.pop()
        if depth > MAX_DEPTH:
            yield Fault(path="document", value="too deeply nested", allowed=f"at most {MAX_DEPTH} levels")
            return
        if isinstance(value, float) and not math.isfinite(value):
            yield Fault(path=path, value=str(value), allowed="a finite number")
        elif isinstance(value, str) and not _is_unicode(value):
            yield Fault(path=path, value=ascii(value)[:60], allowed="text in Unicode")
        elif isinstance(value, list):
            pending.extend((f"{path}[{number}]", item, depth + 1) for number, item in enumerate(value))
        elif isinstance(value, dict):
            pending.extend((ascii(key)[1:-1], key, depth + 1) for key in value if not _is_unicode(key))
            pending.extend((_below(path, key), item, depth + 1) for key, item in value.items())


def _below(path: str, key: str) -> str:
    return ascii(key)[1:-1] if path == "document" else f"{path}.{ascii(key)[1:-1]}"


def _is_unicode(text: str) -> bool:
    return not any("\ud800" <= character <= "\udfff" for character in text) if not text.isascii() else True
