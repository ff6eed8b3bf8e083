"""RoboMaker over HTTP, without a server: requests and answers of the wire, and the documents in them (rest-json).

A request's path says which operation it is for; its bytes become the members of a document, and a document becomes the
bytes of an answer. ARNs are brought from RoboMaker's form to Simyard's own and back. What went wrong is answered with
the error of RoboMaker's that is documented for the operation and comes closest.
"""

import json
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, NoReturn, Union, cast, get_args, get_origin, get_type_hints
from urllib.parse import parse_qsl, unquote

from pydantic import JsonValue, StringConstraints

from specs.arn import ArnForm
from specs.base import Spec
from specs.errors import (
    ConcurrentDeployment,
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ResourceAlreadyExists,
    ResourceNotFound,
    SimyardError,
    StoreAway,
    StoreError,
    StoreThrottled,
)
from specs.field_types import ARN_PATTERN
from specs.robomaker.operations import OPERATIONS, STATUSES, TAGS, ErrorName, Operation, location

_BEFORE_ARN = TAGS.partition("{")[0]
_ROUTES: Mapping[tuple[str, str], Operation] = {(each.method, each.path): each for each in OPERATIONS.values()}
Places = Mapping[str, "Places"]
"""Fields with ARNs, and those with ARNs somewhere below; what a field that is an ARN has below is nothing."""
_ARN_TEXT = f"^(?:{ARN_PATTERN})$"
MOST_LEVELS = 32
"""Of objects and lists in each other; RoboMaker's requests have 8."""
MOST_VALUES = 20_000
"""In a request; the check of each takes memory and time, also of those that are wrong."""
_MOST_VALUES_OF = {"StartSimulationJobBatch": 200_000}  # of 1,000 jobs
_MARKS = (b",", b"[", b"{")
_TEXTS = re.compile(rb'"(?:[^"\\]++|\\.?)*+(?:"|\Z)', re.DOTALL)  # one without an end goes on to the end of all
_MOST_INTEGER = 1 << 63  # what RoboMaker calls long
_OBJECT = "one JSON object in UTF-8"
_URL = re.compile(r"file://[^\s'\";,)]*")
_MOST_CHARACTERS = 4000
_DEFECT = "this is a defect of Simyard; the log of simyard serve says more"
_AWAY = "the store does not answer now; the same request may succeed in a minute"
_STORE = "the store could not do it; the log of simyard serve says more"
_NAMES: tuple[tuple[type[Exception], ErrorName], ...] = (
    (ResourceNotFound, "ResourceNotFound"),
    (ResourceAlreadyExists, "ResourceAlreadyExists"),
    (IdempotentParameterMismatch, "IdempotentParameterMismatch"),
    (LimitExceeded, "LimitExceeded"),
    (ConcurrentDeployment, "ConcurrentDeployment"),
    (DocumentError, "InvalidParameter"),
    (StoreThrottled, "Throttling"),
    (StoreAway, "ServiceUnavailable"),
)


@dataclass(frozen=True)
class HttpRequest:
    """A request, unchanged, as its signature needs it.

    Attributes:
        method: Such as ``POST``.
        raw_path: Still percent-encoded: ARNs in it have slashes that a decoded path would be split at.
        query: Still encoded, without the question mark; empty if there is none.
        headers: Names in lower case, and values, in their order; a name may come several times.
        body: All of it.
        client: The address that it came from.
        id: A new one for each; the answer and the log of actions have it, too.
    """

    method: str
    raw_path: str
    query: str
    headers: tuple[tuple[str, str], ...]
    body: bytes
    client: str = ""
    id: str = ""


@dataclass(frozen=True)
class HttpAnswer:
    """What is sent back.

    Attributes:
        status: HTTP's.
        body: All of it.
        content_type: Of the body.
        error: RoboMaker's code, such as ``ResourceNotFoundException``; empty if it is none.
        headers: Beside content type and length.
    """

    status: int
    body: bytes
    content_type: str = "application/json"
    error: str = ""
    headers: Mapping[str, str] = field(default_factory=dict[str, str])


class Route(NamedTuple):
    """Where a request leads.

    Attributes:
        operation: None if there is none of that method and path.
        place: The part of the path that names a resource, still percent-encoded; empty for most operations.
    """

    operation: Operation | None
    place: str = ""


def route(request: HttpRequest) -> Route:
    """Returns the operation of a request, and what its path names."""
    if request.raw_path.startswith(_BEFORE_ARN):
        return Route(_ROUTES.get((request.method, TAGS)), request.raw_path.removeprefix(_BEFORE_ARN))
    return Route(_ROUTES.get((request.method, request.raw_path)))


def with_arns(document: Mapping[str, Any], shape: type[Spec], change: Callable[[str], str]) -> dict[str, JsonValue]:
    """Returns the data of a document with all its ARNs changed.

    Args:
        document: The data; it may be wrong in any way.
        shape: What it is to be; its types say where ARNs are, so that texts that look like one stay.
        change: Returns the new form of an ARN.
    """
    return _changed(document, _places(shape), change)


def _changed(value: Any, places: Places, change: Callable[[str], str]) -> Any:  # noqa: ANN401 - JSON
    if isinstance(value, str):
        return value if places else change(value)
    if isinstance(value, list):
        return [_changed(item, places, change) for item in cast("list[Any]", value)]
    if isinstance(value, Mapping) and places:
        found = dict(cast("Mapping[str, Any]", value))
        for name in places.keys() & found.keys():
            found[name] = _changed(found[name], places[name], change)
        return found
    return value


@cache
def _places(shape: type[Spec]) -> Places:
    hints = get_type_hints(shape, include_extras=True)
    found = {name: _below(hint) for name, hint in hints.items() if name in shape.model_fields}
    return {name: places for name, places in found.items() if places is not None}


def _below(hint: Any) -> Places | None:  # noqa: ANN401 - a type
    """Returns the places of ARNs in what has a type: none for an ARN itself, None where there cannot be any."""
    if isinstance(hint, type) and issubclass(hint, Spec):
        return _places(hint) or None
    if get_origin(hint) is Annotated:
        kind, *rules = get_args(hint)
        if any(isinstance(rule, StringConstraints) and rule.pattern == _ARN_TEXT for rule in rules):
            return {}
        return _below(kind)
    if get_origin(hint) in {Union, UnionType, tuple}:
        inner = [places for each in get_args(hint) if (places := _below(each)) is not None]
        return inner[0] if inner else None
    return None


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
    if _marks(body, 2 * most_values) > 2 * most_values:  # each value comes after one, and each list begins with one
        raise _refused("a body of too many values", f"at most {most_values:,} values")
    try:
        found = json.loads(body.decode(), object_pairs_hook=_object, parse_int=_integer, parse_constant=_refuse)
    except (ValueError, RecursionError) as exc:
        raise _refused(repr(body[:40]), _OBJECT) from exc
    if not isinstance(found, dict):
        raise _refused(repr(body[:40]), _OBJECT)
    _check_size(found, most_values)
    return _without_nulls(found)


def _marks(body: bytes, enough: int) -> int:
    """Returns how many commas and openings JSON has, outside its texts if there are more than enough of them."""
    if (found := sum(map(body.count, _MARKS))) > enough:
        rest = _TEXTS.sub(b"", body)
        found = sum(map(rest.count, _MARKS))
    return found


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
    return DocumentError.of("body", value, allowed)


def without_places(text: str, store_url: str) -> str:
    """Returns a text without the places of a store and of folders on this machine.

    Args:
        text: A message, or the reason of a failure.
        store_url: Of the store that is served.
    """
    for place in (f"the store {store_url}", store_url, store_url.removeprefix("file://")):
        text = text.replace(place, "the store")
    return _URL.sub("the store", text)


class ErrorAnswers:
    """Errors as clients are told them: in RoboMaker's words, without a place on this machine.

    Args:
        form: Of the ARNs in messages.
        store_url: What no message may show.
    """

    def __init__(self, form: ArnForm, store_url: str) -> None:
        self._form = form
        self._store_url = store_url
        here = (str(Path.cwd()), str(Path.home()), tempfile.gettempdir(), sys.prefix, sys.base_prefix)
        self._here = tuple(each for each in here if len(each) > 1)

    def answer(self, operation: Operation, exc: Exception) -> HttpAnswer:
        """Returns the answer of an operation that an exception ended."""
        name = next((name for kind, name in _NAMES if isinstance(exc, kind)), "InternalServer")
        if name not in operation.errors:
            name = "InvalidParameter" if isinstance(exc, DocumentError) else "InternalServer"
        return error_answer(STATUSES.get(name, 400), f"{name}Exception", self._message(exc))

    def _message(self, exc: Exception) -> str:
        if isinstance(exc, StoreAway):
            return _AWAY
        if isinstance(exc, StoreError):
            return _STORE
        if not isinstance(exc, SimyardError):
            return _DEFECT
        text = "; ".join(map(str, exc.faults)) if isinstance(exc, DocumentError) else str(exc)
        text = without_places(text, self._store_url)
        for place in self._here:
            text = text.replace(place, "the store")
        return self._form.in_prose(text)[:_MOST_CHARACTERS]


def error_answer(status: int, code: str, message: str) -> HttpAnswer:
    """Returns an error in the form that all SDKs read."""
    return HttpAnswer(status, json.dumps({"message": message}).encode(), error=code)
