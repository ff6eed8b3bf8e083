"""The ROS 1 master of an episode: its methods, registrations, look-ups and parameters (wiki.ros.org/ROS/Master_API).

A method answers ``[code, message, value]``: 1 for done, 0 for failed, -1 for a fault of the caller
(wiki.ros.org/ROS/Master_API, wiki.ros.org/ROS/Slave_API).
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, cast

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.parameter_tree import (
    GraphNameError,
    ParameterError,
    ParameterTree,
    change_for,
    check_name,
    resolve_name,
)
from tasks.ros.graph.xml_rpc import (
    NodeCalls,
    Reply,
    Value,
    XmlRpcError,
    node_port,
    read_xml,
    weight,
    write_answer,
    write_fault,
)

ANY_TYPE = "*"


class RegistrationError(ValueError):
    """One registration more than an episode may have."""


class Served(NamedTuple):
    """Who provides a service, and where.

    Attributes:
        node: Its name.
        uri: ``rosrpc://HOST:PORT``.
    """

    node: str
    uri: str


class RegistrationTable:
    """Nodes and their addresses by what they are registered for."""

    def __init__(self) -> None:
        self._nodes: dict[str, dict[str, str]] = {}

    def __iter__(self) -> Iterator[str]:
        """Yields what somebody is registered for."""
        return iter(self._nodes)

    def of(self, key: str) -> dict[str, str]:
        """Returns the addresses of the nodes registered for a topic or parameter, by their names: a copy."""
        return dict(self._nodes.get(key, ()))

    def state(self) -> list[tuple[str, list[str]]]:
        """Returns the names of the nodes registered for each topic."""
        return [(key, list(nodes)) for key, nodes in self._nodes.items()]

    def add(self, key: str, node: str, uri: str) -> bool:
        """Registers a node; returns whether it was not registered before."""
        nodes = self._nodes.setdefault(key, {})
        new = node not in nodes
        nodes[node] = uri
        return new

    def remove(self, key: str, node: str, uri: str | None = None) -> bool:
        """Takes a registration back; returns whether there was one, at that address if it is named."""
        nodes = self._nodes.get(key, {})
        if node not in nodes or uri not in (None, nodes[node]):
            return False
        del nodes[node]
        if not nodes:
            del self._nodes[key]
        return True

    def remove_node(self, node: str) -> list[str]:
        """Takes all registrations of a node back; returns what they were for."""
        return [key for key in list(self._nodes) if self.remove(key, node)]


class Registrations:
    """All tables of an episode.

    Attributes:
        publishers, subscribers: By topic.
        followers: By parameter.
        services: By name.
        types: Of topics.
        changes: Grows with every registration.
        added: Grows with every registration of a publisher or subscriber: nodes connect for these alone.
    """

    def __init__(self) -> None:
        self.publishers, self.subscribers, self.followers = (
            RegistrationTable(),
            RegistrationTable(),
            RegistrationTable(),
        )
        self.services: dict[str, Served] = {}
        self.types: dict[str, str] = {}
        self.changes = self.added = 0
        self._uris: dict[str, str] = {}
        self._replaced: dict[str, str] = {}
        self._counts: Counter[str] = Counter()

    @property
    def nodes(self) -> dict[str, str]:
        """Returns the addresses of all nodes, by their names."""
        return self._uris

    def enter(self, node: str, uri: str) -> str | None:
        """Notes a node's address.

        Returns:
            The address of an older node of the same name, whose registrations are gone now; None if there is none.

        Raises:
            RegistrationError: If there are as many registrations as there may be, or another node took this one's
                place: it may still call before it has ended, and would end the new one in its turn.
        """
        if self._replaced.get(node) == uri:
            raise RegistrationError(f"a new node has the same name, {node}")
        if self._counts.total() >= limits.REGISTRATIONS:
            raise RegistrationError(f"an episode has at most {limits.REGISTRATIONS} registrations")
        old = self._uris.get(node)
        if old is None and len(self._uris) > limits.NODES:
            raise RegistrationError(f"an episode has at most {limits.NODES} nodes")
        self.changes += 1
        self._uris[node] = uri
        if old in (None, uri):
            return None
        if len(self._replaced) >= limits.NODES:
            del self._replaced[next(iter(self._replaced))]
        self._replaced[node] = old
        return old

    def leave(self, node: str) -> list[str]:
        """Takes all registrations of a node back; returns the topics that it published."""
        topics = self.publishers.remove_node(node)
        for topic in [*topics, *self.subscribers.remove_node(node)]:
            self._forget_type(topic)
        self.followers.remove_node(node)
        self.services = {name: each for name, each in self.services.items() if each.node != node}
        self._counts.pop(node, None)
        self.changes += 1
        return topics

    def add(self, table: RegistrationTable, key: str, node: str) -> None:
        """Registers a node that has entered."""
        self._counts[node] += table.add(key, node, self._uris[node])
        self.added += table is not self.followers

    def remove(self, table: RegistrationTable, key: str, node: str, uri: str) -> bool:
        """Takes a registration back; a node that has none left is gone."""
        removed = table.remove(key, node, uri)
        self._count_down(node, removed=removed)
        self._forget_type(key)
        return removed

    def serve(self, service: str, node: str, uri: str) -> None:
        """Registers the provider of a service, in the place of another one."""
        old = self.services.get(service)
        if old is not None:
            self._count_down(old.node, removed=True, stays=node)
        self.services[service] = Served(node, uri)
        self._counts[node] += 1

    def withdraw(self, service: str, node: str, uri: str) -> bool:
        """Takes a service back, if it is still the node's."""
        removed = self.services.get(service) == Served(node, uri)
        if removed:
            del self.services[service]
        self._count_down(node, removed=removed)
        return removed

    def type_topic(self, topic: str, kind: str, *, publisher: bool) -> None:
        """Notes a topic's type as ROS's own master does: the last publisher's counts, before any subscriber's."""
        new = topic not in self.types
        if (publisher and (new or kind != ANY_TYPE)) or (new and kind != ANY_TYPE):
            self.types[topic] = kind

    def _forget_type(self, topic: str) -> None:
        if not self.publishers.of(topic) and not self.subscribers.of(topic):
            self.types.pop(topic, None)

    def _count_down(self, node: str, *, removed: bool, stays: str = "") -> None:
        self.changes += 1
        self._counts[node] -= removed
        if self._counts[node] <= 0:
            del self._counts[node]
            if node != stays:
                self._uris.pop(node, None)


Outcome = tuple[int, str, Value]
_MULTICALL = "system.multicall"


class ArgumentKind(NamedTuple):
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
    kinds: tuple[ArgumentKind, ...] = ()
    optional: int = 0


def _name(value: Value, caller: str, what: str) -> str:
    return resolve_name(check_name(value, what), caller)


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


TOPIC, SERVICE, NAME = ArgumentKind("topic", _topic), ArgumentKind("service", _topic), ArgumentKind("name", _name)
KEY, SEARCHED = ArgumentKind("parameter", _name), ArgumentKind("parameter", _relative_name)
TYPE, LIST, VALUE = ArgumentKind("type", _type), ArgumentKind("list", _list), ArgumentKind("value", _anything)
NODE_URI, SERVICE_URI = ArgumentKind("node's address", _node_uri), ArgumentKind("service's address", _service_uri)
TEXT = ArgumentKind("text", _text)


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
            arguments, method = read_xml(body)
            calls = _multicall(arguments) if method == _MULTICALL else [(method, arguments)]
            found = self._call_all(calls)
        except XmlRpcError as exc:
            reply(write_fault(str(exc)))
            return
        # Each answer of a multicall is a list of one.
        data = write_answer([[each] for each in found] if method == _MULTICALL else found[0])
        topics = frozenset(
            resolve_name(str(each[1]), str(each[0]))
            for name, each in calls
            if name == "registerPublisher" and len(each) > 1
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


NAME_OF_MASTER = "/master"


class Master:
    """Answers the master's API.

    Args:
        uri: Its own address.
        tables: Who is registered for what.
        parameters: Of the episode.
        calls: Tells nodes of changes.
        publishers_changed: Called with a topic of the robot's own instead of a call to itself.
        robot: Name of the robot's own node.
    """

    def __init__(
        self,
        uri: str,
        *,
        tables: Registrations,
        parameters: ParameterTree,
        calls: NodeCalls,
        publishers_changed: Callable[[str], None],
        robot: str,
    ) -> None:
        self._uri, self._tables, self._parameters, self._calls = uri, tables, parameters, calls
        self._publishers_changed, self._robot = publishers_changed, robot
        self._asked = set[tuple[str, str]]()

    def take_asked(self) -> set[tuple[str, str]]:
        """Returns who asked for a service since the last call, and which node has it: it is called next."""
        asked, self._asked = self._asked, set()
        return asked

    def methods(self) -> Mapping[str, Method]:
        """Returns the API by its methods' names."""
        return {
            "getUri": Method(lambda _: (1, "", self._uri)),
            "registerPublisher": Method(self._register_publisher, (TOPIC, TYPE, NODE_URI)),
            "unregisterPublisher": Method(self._unregister_publisher, (TOPIC, NODE_URI)),
            "registerSubscriber": Method(self._register_subscriber, (TOPIC, TYPE, NODE_URI)),
            "unregisterSubscriber": Method(self._unregister_subscriber, (TOPIC, NODE_URI)),
            "registerService": Method(self._register_service, (SERVICE, SERVICE_URI, NODE_URI)),
            "unregisterService": Method(self._unregister_service, (SERVICE, SERVICE_URI)),
            "lookupService": Method(self._look_up_service, (SERVICE,)),
            "lookupNode": Method(self._look_up_node, (NAME,)),
            "getPublishedTopics": Method(self._published_topics, (TEXT,)),
            "getTopicTypes": Method(lambda _: (1, "", [[*each] for each in self._tables.types.items()])),
            "getSystemState": Method(self._system_state),
            "getParam": Method(self._get, (KEY,)),
            "setParam": Method(self.set, (KEY, VALUE)),
            "deleteParam": Method(self._delete, (KEY,)),
            "hasParam": Method(lambda _, key: (1, key, self._parameters.has(key)), (KEY,)),
            "searchParam": Method(self._search, (SEARCHED,)),
            "subscribeParam": Method(self._follow, (NODE_URI, KEY)),
            "unsubscribeParam": Method(self._unfollow, (NODE_URI, KEY)),
            "getParamNames": Method(lambda _: (1, "", [*self._parameters.names()])),
        }

    def set(self, caller: str, key: str, value: Value) -> Outcome:
        """Sets a parameter, and tells the nodes that follow it, besides the caller."""
        self._parameters.set(key, value)
        self._tell_followers(caller, key, value)
        return 1, f"parameter {key} set", 0

    def _register_publisher(self, caller: str, topic: str, kind: str, uri: str) -> Outcome:
        self._enter(caller, uri)
        self._tables.add(self._tables.publishers, topic, caller)
        self._tables.type_topic(topic, kind, publisher=True)
        self._tell_subscribers(topic)
        return 1, f"{caller} publishes {topic}", [*self._tables.subscribers.of(topic).values()]

    def _unregister_publisher(self, caller: str, topic: str, uri: str) -> Outcome:
        removed = self._tables.remove(self._tables.publishers, topic, caller, uri)
        if removed:
            self._tell_subscribers(topic)
        return _removed(caller, topic, removed=removed)

    def _register_subscriber(self, caller: str, topic: str, kind: str, uri: str) -> Outcome:
        self._enter(caller, uri)
        self._tables.add(self._tables.subscribers, topic, caller)
        self._tables.type_topic(topic, kind, publisher=False)
        return 1, f"{caller} subscribes to {topic}", [*self._tables.publishers.of(topic).values()]

    def _unregister_subscriber(self, caller: str, topic: str, uri: str) -> Outcome:
        removed = self._tables.remove(self._tables.subscribers, topic, caller, uri)
        return _removed(caller, topic, removed=removed)

    def _register_service(self, caller: str, service: str, service_uri: str, uri: str) -> Outcome:
        self._enter(caller, uri)
        self._tables.serve(service, caller, service_uri)
        return 1, f"{caller} provides {service}", 1

    def _unregister_service(self, caller: str, service: str, service_uri: str) -> Outcome:
        return _removed(caller, service, removed=self._tables.withdraw(service, caller, service_uri))

    def _look_up_service(self, caller: str, service: str) -> Outcome:
        found = self._tables.services.get(service)
        if found is not None and len(self._asked) < limits.CALLS:
            self._asked.add((caller, found.node))
        return (-1, f"nobody provides {service}", "") if found is None else (1, found.node, found.uri)

    def _look_up_node(self, _: str, name: str) -> Outcome:
        uri = self._tables.nodes.get(name)
        return (-1, f"no node {name}", "") if uri is None else (1, name, uri)

    def _published_topics(self, caller: str, below: str) -> Outcome:
        prefix = "" if below in ("", "/") else f"/{below.strip('/')}/"
        types = self._tables.types
        return 1, caller, [[topic, types[topic]] for topic in self._tables.publishers if topic.startswith(prefix)]

    def _system_state(self, caller: str) -> Outcome:
        services: list[Value] = [[name, [each.node]] for name, each in self._tables.services.items()]
        return 1, caller, [_state(self._tables.publishers), _state(self._tables.subscribers), services]

    def _enter(self, caller: str, uri: str) -> None:
        """Notes a node; one with another address takes the place of the old one, which is shut down."""
        if not caller or caller == self._robot:
            raise ValueError(f"{caller!r} is no name for a node: {self._robot} is the robot's own")
        old = self._tables.enter(caller, uri)
        if old is not None:
            for topic in self._tables.leave(caller):
                self._tell_subscribers(topic)
            reason = f"a new node has the same name, {caller}"
            self._calls.call(old, "shutdown", (NAME_OF_MASTER, reason))

    def _tell_subscribers(self, topic: str) -> None:
        uris: Value = [*self._tables.publishers.of(topic).values()]
        for name, uri in self._tables.subscribers.of(topic).items():
            if name == self._robot:
                self._publishers_changed(topic)
            else:
                self._calls.call(uri, "publisherUpdate", (NAME_OF_MASTER, topic, uris))

    # Parameters

    def _get(self, _: str, key: str) -> Outcome:
        try:
            return 1, key, self._parameters.get(key)
        except KeyError:
            return -1, f"parameter {key} is not set", 0

    def _delete(self, _: str, key: str) -> Outcome:
        try:
            self._parameters.delete(key)
        except KeyError:
            return -1, f"parameter {key} is not set", 0
        self._tell_followers("", key, {})
        return 1, f"parameter {key} deleted", 0

    def _search(self, caller: str, key: str) -> Outcome:
        found = self._parameters.search(key, caller)
        return (-1, f"no parameter {key} around {caller}", "") if found is None else (1, found, found)

    def _follow(self, caller: str, uri: str, key: str) -> Outcome:
        self._enter(caller, uri)
        self._tables.add(self._tables.followers, key, caller)
        return 1, key, self._parameters.get(key) if self._parameters.has(key) else {}

    def _unfollow(self, caller: str, uri: str, key: str) -> Outcome:
        # ROS's own master says 1 whether there was anything to take back or not.
        removed = self._tables.remove(self._tables.followers, key, caller, uri)
        return 1, _removed(caller, key, removed=removed)[1], 1

    def _tell_followers(self, caller: str, key: str, value: Value) -> None:
        for followed in self._tables.followers:
            change = change_for(followed, key, value)
            if change is None:
                continue
            for name, uri in self._tables.followers.of(followed).items():
                if name != caller:
                    self._calls.call(uri, "paramUpdate", (NAME_OF_MASTER, *change))


def _removed(caller: str, key: str, *, removed: bool) -> Outcome:
    return 1, f"{caller} is {'no longer' if removed else 'not'} registered for {key}", int(removed)


def _state(table: RegistrationTable) -> Value:
    return [[key, [*nodes]] for key, nodes in table.state()]
