"""rest-json: a request's bytes to the members of a document, and a document to the bytes of an answer."""

import json
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
    found = _body(request.body) if "body" in places.values() or not places else {}
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


def _body(body: bytes) -> dict[str, JsonValue]:
    if not body.strip():
        return {}
    try:
        found = json.loads(body.decode(), object_pairs_hook=_object, parse_constant=_refuse)
    except (ValueError, RecursionError) as exc:
        raise _refused(repr(body[:40]), _OBJECT) from exc
    if not isinstance(found, dict):
        raise _refused(repr(body[:40]), _OBJECT)
    return _without_nulls(found, 0)


def _object(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise _refused(repr(key[:40]), "each key once")
        found[key] = value
    return found


def _refuse(constant: str) -> NoReturn:
    raise _refused(constant, "a number")


def _without_nulls(value: Any, level: int) -> Any:  # noqa: ANN401 - JSON
    # What is null was not sent; some SDKs write it down.
    if level > MOST_LEVELS:
        raise _refused(f"{level} levels", f"at most {MOST_LEVELS} levels of objects and lists")
    if isinstance(value, dict):
        return {key: _without_nulls(below, level + 1) for key, below in value.items() if below is not None}
    if isinstance(value, list):
        return [_without_nulls(below, level + 1) for below in value if below is not None]
    return value


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="body", value=value, allowed=allowed)])
