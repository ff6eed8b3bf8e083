"""The ROS 1 master of an episode: registrations, look-ups and parameters (wiki.ros.org/ROS/Master_API)."""

from collections.abc import Callable, Mapping

from tasks.ros.graph.method import (
    KEY,
    NAME,
    NODE_URI,
    SEARCHED,
    SERVICE,
    SERVICE_URI,
    TEXT,
    TOPIC,
    TYPE,
    VALUE,
    Method,
    Outcome,
)
from tasks.ros.graph.parameter_tree import ParameterTree, change_for
from tasks.ros.graph.registrations import Registrations, Table
from tasks.ros.graph.wire.node_call import NodeCalls
from tasks.ros.graph.wire.xml_rpc import Value

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

    def _look_up_service(self, _: str, service: str) -> Outcome:
        found = self._tables.services.get(service)
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


def _state(table: Table) -> Value:
    return [[key, [*nodes]] for key, nodes in table.state()]
