"""Who publishes, subscribes, serves and follows what: the tables of a ROS master."""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from tasks.ros.graph.wire import graph_limits as limits

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


class Table:
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
    """

    def __init__(self) -> None:
        self.publishers, self.subscribers, self.followers = Table(), Table(), Table()
        self.services: dict[str, Served] = {}
        self.types: dict[str, str] = {}
        self.changes = 0
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

    def add(self, table: Table, key: str, node: str) -> None:
        """Registers a node that has entered."""
        self._counts[node] += table.add(key, node, self._uris[node])

    def remove(self, table: Table, key: str, node: str, uri: str) -> bool:
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
