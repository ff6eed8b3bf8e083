"""Reads a YAML or JSON file into plain data, without any surprise.

YAML is read as a notation for JSON: true, false, null, decimal numbers and text. Anchors, aliases, tags, several
documents in a file and keys that are not text are refused, and ``no``, ``010`` or ``2026-11-21`` are text.
"""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import yaml
from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.world_sections import source_kind

_BASE: type[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_MERGE_KEY = "<<"
_NULL = "tag:yaml.org,2002:null"
_RESOLVERS = (
    ("tag:yaml.org,2002:bool", re.compile(r"true|True|TRUE|false|False|FALSE"), "tTfF"),
    ("tag:yaml.org,2002:int", re.compile(r"[-+]?(?:0|[1-9][0-9]*)"), "-+0123456789"),
    (
        "tag:yaml.org,2002:float",
        re.compile(r"[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"),
        "-+0123456789.",
    ),
    (_NULL, re.compile(r"~|null|Null|NULL|"), "~nN\0"),
)

MAX_BYTES = 1 << 20
MAX_DEPTH = 40
_WANTED = "a YAML or JSON document of at most 1 MiB"


class _RefusedError(ValueError):
    """Text that is neither JSON nor YAML that notes it, or no plain data: where, what stands there, what may."""

    def __init__(self, where: str, what: str, allowed: str) -> None:
        super().__init__(what)
        self.where = where
        self.what = what
        self.allowed = allowed


class _Loader(_BASE):
    """A loader that knows JSON's types only, and no key twice."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012 - PyYAML's own attribute
    yaml_constructors: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's own attribute


def _load_yaml(text: str, max_depth: int) -> JsonValue:
    """Returns the data of one YAML document.

    Raises:
        _RefusedError: For malformed YAML, anchors, aliases, tags, keys that are not text or occur twice, a second
            document, or more levels than ``max_depth``.
    """
    try:
        _check_events(text, max_depth)
        return cast("JsonValue", yaml.load(text, Loader=_Loader))  # noqa: S506 - knows JSON's types only
    except yaml.MarkedYAMLError as exc:
        raise _RefusedError(
            _place(exc.problem_mark), *_syntax(exc.problem or "not YAML", text, exc.problem_mark)
        ) from exc
    except yaml.YAMLError as exc:
        raise _RefusedError("file", " ".join(str(exc).split()), "YAML") from exc


def _syntax(problem: str, text: str, mark: Any) -> tuple[str, str]:  # noqa: ANN401 - see _place
    """Returns what stands where a parser stopped, and what may, for mistakes that are made again and again."""
    lines = text.splitlines()
    if mark is not None and mark.line < len(lines) and "\t" in lines[mark.line][: mark.column + 1]:
        return "a tab", "spaces, by which alone YAML indents"
    if problem.startswith("did not find expected"):
        return problem, "the indentation of the lines that it belongs to, and brackets and quotes that are closed"
    if problem.startswith("mapping values are not allowed"):
        return "a second colon before a space", 'a text with ": " in it in quotes, and a new key on a line of its own'
    return problem, "YAML"


def _check_events(text: str, max_depth: int) -> None:
    """Refuses what events show, before anything is composed: an alias costs nothing to write and much to expand."""
    depth = documents = 0
    for event in yaml.parse(text, Loader=_Loader):
        documents += isinstance(event, yaml.DocumentStartEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        problem = _problem(event)
        if problem is not None:
            raise _RefusedError(_place(event.start_mark), *problem)
        if depth > max_depth:
            raise _RefusedError(_place(event.start_mark), "too deeply nested", f"at most {max_depth} levels")
        if documents > 1:
            raise _RefusedError(_place(event.start_mark), "a second document", "one document in a file")


def _problem(event: yaml.Event) -> tuple[str, str] | None:
    anchor = getattr(event, "anchor", None)
    if isinstance(event, yaml.AliasEvent):
        return f"the alias *{anchor}", "the value itself; aliases are not allowed"
    if anchor is not None:
        return f"the anchor &{anchor}", "values without anchors"
    tag = getattr(event, "tag", None)
    return (f"the tag {tag}", "values without tags") if tag is not None else None


def _place(mark: Any) -> str:  # noqa: ANN401 - the C and the Python parser have each their own marks
    return "file" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}"


def _construct_scalar(loader: Any, node: yaml.ScalarNode) -> JsonValue:  # noqa: ANN401 - see _Loader
    text = str(loader.construct_scalar(node))
    match node.tag.rpartition(":")[2]:
        case "bool":
            return text.lower() == "true"
        case "int":
            return _number(int, text, node)
        case "float":
            return _number(float, text, node)
        case "null":
            return None
        case _:
            return text


def _number(kind: type[int] | type[float], text: str, node: yaml.Node) -> int | float:
    try:
        return kind(text)
    except ValueError as exc:
        raise _RefusedError(_place(node.start_mark), f"a number of {len(text)} digits", "shorter numbers") from exc


def _construct_list(loader: Any, node: yaml.SequenceNode) -> list[JsonValue]:  # noqa: ANN401 - see _Loader
    return [loader.construct_object(item, deep=True) for item in node.value]


def _construct_object(loader: Any, node: yaml.MappingNode) -> dict[str, JsonValue]:  # noqa: ANN401 - see _Loader
    found: dict[str, JsonValue] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            raise _RefusedError(_place(key_node.start_mark), f"the key {key}", "keys of text; quote it")
        if key in found:
            raise _RefusedError(_place(key_node.start_mark), f"the key {key} for the second time", "each key once")
        if key == _MERGE_KEY and not key_node.style:  # quoted, it is a key like any other
            raise _RefusedError(_place(key_node.start_mark), "a merge key", "values written out")
        found[key] = loader.construct_object(value_node, deep=True)
    return found


for _tag, _pattern, _firsts in _RESOLVERS:
    _whole = re.compile(rf"(?:{_pattern.pattern})\Z")
    _Loader.add_implicit_resolver(_tag, _whole, ["" if first == "\0" else first for first in _firsts])
for _tag in ("bool", "int", "float", "null", "str"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _construct_scalar)
_Loader.add_constructor("tag:yaml.org,2002:seq", _construct_list)
_Loader.add_constructor("tag:yaml.org,2002:map", _construct_object)


def read_document(path: Path) -> JsonValue:
    """Returns the data in a YAML or JSON file.

    Raises:
        DocumentError: When there is no such file, or it is not readable, or as for `decode_document`; or it is what a
            world is imported from.
    """
    if path.is_file() and source_kind(path.name) not in (None, "map"):
        raise _importable(path, "a building")
    try:
        with path.open("rb") as file:
            body = file.read(MAX_BYTES + 1)
    except FileNotFoundError as exc:
        raise _refused("there is no such file", _WANTED, str(path)) from exc
    except IsADirectoryError as exc:
        raise _refused("it is a folder", _WANTED, str(path)) from exc
    except (OSError, ValueError) as exc:
        raise _refused(f"it cannot be read ({exc})", _WANTED, str(path)) from exc
    data = decode_source_text(body, str(path))
    if isinstance(data, dict) and data.keys() >= _OF_A_MAP:
        raise _importable(path, "a map of ROS")
    return data


_OF_A_MAP = {"image", "resolution", "origin"}


def _importable(path: Path, what: str) -> DocumentError:
    """Returns the refusal of a file that is no document, and that a world can be made of."""
    entry = f"`worlds: [{{name: {path.stem}, source: {path.name}}}]`"
    allowed = f"`simyard world import {path}` makes a world of it, and {entry} does in a document beside it"
    return DocumentError.of("file", f"{what}, and no document", allowed, source=str(path))


def decode_source_text(body: bytes, source: str) -> JsonValue:
    """Returns the data in a YAML or JSON document.

    Args:
        body: The document.
        source: Where it comes from; JSON when that ends in ``.json``, else what the text is.

    Raises:
        DocumentError: When it is longer than 1 MiB, not UTF-8 or malformed, or holds what plain data cannot (aliases,
            a key twice, NaN, more than 40 levels).
    """
    if len(body) > MAX_BYTES:
        raise _refused(f"more than {MAX_BYTES:,} bytes", _WANTED, source)
    try:
        text = body.decode("utf-8-sig")
        is_json = source.lower().endswith(".json") or _is_json(text)
        data = _load_json(text) if is_json else _load_yaml(text, MAX_DEPTH)
    except UnicodeDecodeError as exc:
        raise _refused(f"byte {exc.start} is not UTF-8", "text in UTF-8", source) from exc
    except _RefusedError as exc:
        raise DocumentError.of(exc.where, exc.what, exc.allowed, source=source) from exc
    faults = list(_not_plain(data))
    if faults:
        raise DocumentError(faults, source)
    return data


def _refused(value: str, allowed: str, source: str) -> DocumentError:
    return DocumentError.of("file", value, allowed, source=source)


def _is_json(text: str) -> bool:
    """Returns whether a text is JSON; nearly all of it is YAML as well, but YAML has no pairs of surrogates."""
    try:
        return text.lstrip().startswith("{") and bool(json.loads(text))
    except (ValueError, RecursionError):
        return False


def _load_json(text: str) -> JsonValue:
    try:
        return cast("JsonValue", json.loads(text, object_pairs_hook=_object, parse_constant=_constant))
    except json.JSONDecodeError as exc:
        raise _RefusedError(f"line {exc.lineno}, column {exc.colno}", exc.msg, "JSON") from exc
    except RecursionError as exc:
        raise _RefusedError("file", "too deeply nested", f"at most {MAX_DEPTH} levels") from exc
    except _RefusedError:
        raise
    except ValueError as exc:
        raise _RefusedError("file", "a number of thousands of digits", "shorter numbers") from exc


def _object(pairs: list[tuple[str, JsonValue]]) -> dict[str, JsonValue]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for number, key in enumerate(keys) if key in keys[:number])
        raise _RefusedError(twice, "occurs twice in one object", "each key once")
    return found


def _constant(name: str) -> JsonValue:
    raise _RefusedError("file", name, "numbers that are finite")


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
