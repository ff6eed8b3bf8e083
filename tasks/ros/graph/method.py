"""Methods of the master's and the node's API: how their arguments are checked, and how calls are answered.

Each answers ``[code, message, value]``: 1 for done, 0 for failed, -1 for a fault of the caller
(wiki.ros.org/ROS/Master_API, wiki.ros.org/ROS/Slave_API).
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, cast

from tasks.ros.graph.graph_name import GraphNameError, check_name, resolve
from tasks.ros.graph.parameter_tree import ParameterError
from tasks.ros.graph.registrations import RegistrationError
from tasks.ros.graph.wire import graph_limits as limits
from tasks.ros.graph.wire.http import Reply
from tasks.ros.graph.wire.node_call import node_port
from tasks.ros.graph.wire.xml_rpc import Value, XmlRpcError, read, weight, write_answer, write_fault

Outcome = tuple[int, str, Value]
_MULTICALL = "system.multicall"


class Kind(NamedTuple):
    """What an argument is.

    Attributes:
        what: For messages.
        check: Returns it as the method takes it; gets the caller's name too.
    """

    what: str
    check: Callable[[Value, str, str], Value]


class Method(NamedTuple):
    """A method of an API, the caller's name first.

    Attributes:
        function: Returns the outcome.
        kinds: Of the arguments after the caller's name.
        optional: How many of the last ones may be left out.
    """

    function: Callable[..., Outcome]
    kinds: tuple[Kind, ...] = ()
    optional: int = 0


def _name(value: Value, caller: str, what: str) -> str:
    return resolve(check_name(value, what), caller)


def _topic(value: Value, caller: str, what: str) -> str:
    name = _name(value, caller, what)
    if name == "/":
        raise GraphNameError(f"{what} cannot be /")
    return name


def _type(value: Value, _: str, what: str) -> str:
    kind = check_name(value, what)
    if kind != "*" and kind.count("/") != 1:
        raise GraphNameError(f"{what} {kind[:80]!r}: a type is package/Name, or *")
    return kind


def _node_uri(value: Value, _: str, what: str) -> str:
    uri = _text(value, "", what)
    node_port(uri)
    return uri


def _service_uri(value: Value, _: str, what: str) -> str:
    uri = _text(value, "", what)
    if not uri.startswith("rosrpc://"):
        raise GraphNameError(f"{what} {uri[:80]!r}: a service's address is rosrpc://HOST:PORT")
    return uri


def _text(value: Value, _: str, what: str) -> str:
    if not isinstance(value, str) or len(value) > limits.NAME_CHARACTERS:
        raise GraphNameError(f"{what} must be a text of at most {limits.NAME_CHARACTERS} characters")
    return value


def _list(value: Value, _: str, what: str) -> Value:
    if not isinstance(value, list):
        raise GraphNameError(f"{what} must be a list")
    return value


def _relative_name(value: Value, _: str, what: str) -> str:
    name = check_name(value, what)
    if name.startswith("~"):
        raise GraphNameError(f"{what} {name[:80]!r}: a search takes no private name")
    return name


def _anything(value: Value, _: str, what: str) -> Value:
    if value is None:
        raise GraphNameError(f"{what} is missing")
    return value


TOPIC, SERVICE, NAME = Kind("topic", _topic), Kind("service", _topic), Kind("name", _name)
KEY, SEARCHED = Kind("parameter", _name), Kind("parameter", _relative_name)
TYPE, LIST, VALUE = Kind("type", _type), Kind("list", _list), Kind("value", _anything)
NODE_URI, SERVICE_URI = Kind("node's address", _node_uri), Kind("service's address", _service_uri)
TEXT = Kind("text", _text)


class Dispatch:
    """Answers calls with the methods of an API.

    Args:
        methods: By their names.
        hold: Called with the topics that a call's node publishes from now on, and with what sends the answer.
    """

    def __init__(
        self, methods: Mapping[str, Method], hold: Callable[[frozenset[str], Callable[[], None]], None]
    ) -> None:
        self._methods, self._hold = methods, hold

    def answer(self, body: bytes, reply: Reply) -> None:
        """Answers the XML of a call, now or when the robot is connected."""
        try:
            arguments, method = read(body)
            calls = _multicall(arguments) if method == _MULTICALL else [(method, arguments)]
            found = self._call_all(calls)
        except XmlRpcError as exc:
            reply(write_fault(str(exc)))
            return
        # Each answer of a multicall is a list of one.
        data = write_answer([[each] for each in found] if method == _MULTICALL else found[0])
        topics = frozenset(
            resolve(str(each[1]), str(each[0])) for name, each in calls if name == "registerPublisher" and len(each) > 1
        )
        self._hold(topics, lambda: reply(data))

    def _call_all(self, calls: list[tuple[str | None, tuple[Value, ...]]]) -> list[Value]:
        found: list[Value] = []
        size = 0
        for each in calls:
            code, message, value = self._call(*each)
            found.append([code, message, value])
            size += weight(value)
            if size > limits.PARAMETER_BYTES + limits.BODY_BYTES:
                raise XmlRpcError("an answer of more bytes than all parameters have")
        return found

    def _call(self, name: str | None, arguments: tuple[Value, ...]) -> Outcome:
        method = self._methods.get(name or "")
        if method is None:
            return -1, f"no method {name!r:.80}", 0
        try:
            return method.function(*_checked(method, arguments))
        except (GraphNameError, ParameterError, RegistrationError, ValueError) as exc:
            return -1, str(exc), 0


def _checked(method: Method, arguments: tuple[Value, ...]) -> list[Value]:
    most = len(method.kinds) + 1
    if not most - method.optional <= len(arguments) <= most:
        raise GraphNameError(f"{len(arguments)} arguments: {most} are taken, the caller's name first")
    caller, *rest = arguments
    if not isinstance(caller, str) or len(caller) > limits.NAME_CHARACTERS:
        raise GraphNameError("the caller's name must be a text")
    return [caller, *(kind.check(value, caller, kind.what) for kind, value in zip(method.kinds, rest, strict=False))]


def _multicall(arguments: tuple[Value, ...]) -> list[tuple[str | None, tuple[Value, ...]]]:
    calls: Any = arguments[0] if len(arguments) == 1 else None
    if not isinstance(calls, list) or len(cast("list[Value]", calls)) > limits.CALLS:
        raise XmlRpcError(f"system.multicall takes one list of at most {limits.CALLS} calls")
    found: list[tuple[str | None, tuple[Value, ...]]] = []
    for each in cast("list[Value]", calls):
        match each:
            case {"methodName": str(name), "params": list(params)} if name != _MULTICALL:
                found.append((name, tuple(params)))
            case _:
                raise XmlRpcError("a call within system.multicall is {methodName, params}")
    return found
