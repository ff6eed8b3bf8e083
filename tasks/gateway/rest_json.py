"""rest-json: a request's bytes to the members of a document, and a document to the bytes of an answer."""

import json
from collections import Counter
from collections.abc import Iterable
from typing import Any, NoReturn
from urllib.parse import parse_qsl, unquote

from pydantic import JsonValue

from specs.base import Fault, Spec
from specs.errors import DocumentError
from specs.interface.operations import location
from tasks.gateway.messages import HttpAnswer, HttpRequest
from tasks.gateway.routes import Route

MOST_LEVELS = 32
"""Of objects and lists in each other; RoboMaker's requests have 8."""
MOST_VALUES = 20_000
"""In a request; the check of each takes memory and time, also of those that are wrong."""
_MOST_VALUES_OF = {"StartSimulationJobBatch": 200_000}  # of 1,000 jobs
_MOST_INTEGER = 1 << 63  # what RoboMaker calls long
_OBJECT = "one JSON object in UTF-8"


def request_members(route: Route, request: HttpRequest, shape: type[Spec]) -> dict[str, JsonValue]:
    """Returns the members of a request, wherever they are sent.

    Args:
        route: The operation, and what the path names.
        request: As it came.
        shape: The operation's request, whose members are looked for.

    Raises:
        DocumentError: The body is not one JSON object, or has a key twice.
    """
    assert route.operation  # noqa: S101 - a request without an operation has no members
    places = {name: location(route.operation, name) for name in shape.model_fields}
    most = _MOST_VALUES_OF.get(route.operation.name, MOST_VALUES)
    found = _body(request.body, most) if "body" in places.values() or not places else {}
    for name, place in places.items():
        if place == "uri":
            found[name] = unquote(route.place)
        elif place == "querystring":
            pairs = parse_qsl(request.query, keep_blank_values=True)
            found[name] = [value for key, value in pairs if key == name]
    return found


def written(document: dict[str, JsonValue]) -> HttpAnswer:
    """Returns the members of an answer as bytes."""
    return HttpAnswer(200, json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode())


def _body(body: bytes, most_values: int) -> dict[str, JsonValue]:
    if not body.strip():
        return {}
    try:
        found = json.loads(body.decode(), object_pairs_hook=_object, parse_int=_integer, parse_constant=_refuse)
    except (ValueError, RecursionError) as exc:
        raise _refused(repr(body[:40]), _OBJECT) from exc
    if not isinstance(found, dict):
        raise _refused(repr(body[:40]), _OBJECT)
    _check_size(found, most_values)
    return _without_nulls(found)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice, _ = Counter(key for key, _ in pairs).most_common(1)[0]
        raise _refused(repr(twice[:40]), "each key once")
    return found


def _integer(text: str) -> int:
    value = int(text)
    if not -_MOST_INTEGER <= value < _MOST_INTEGER:
        raise _refused(text[:40], "a whole number of 64 bits")
    return value


def _refuse(constant: str) -> NoReturn:
    raise _refused(constant, "a number")


def _check_size(document: dict[str, Any], most_values: int) -> None:
    """Refuses more levels and values than any request has.

    Raises:
        DocumentError: There are more.
    """
    level: list[Any] = [document]
    count, depth = 0, 0
    while level:
        level = [below for each in level for below in _inside(each)]
        count, depth = count + len(level), depth + 1
        if depth > MOST_LEVELS:
            raise _refused(f"{depth} levels", f"at most {MOST_LEVELS} levels of objects and lists")
        if count > most_values:
            raise _refused(f"{count:,} values or more", f"at most {most_values:,} values")


def _inside(value: Any) -> Iterable[Any]:  # noqa: ANN401 - JSON
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _without_nulls(value: Any) -> Any:  # noqa: ANN401 - JSON
    # What is null was not sent; some SDKs write it down.
    if isinstance(value, dict):
        return {key: _without_nulls(below) for key, below in value.items() if below is not None}
    if isinstance(value, list):
        return [_without_nulls(below) for below in value if below is not None]
    return value


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="body", value=value, allowed=allowed)])
