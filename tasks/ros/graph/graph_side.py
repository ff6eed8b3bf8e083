"""What lock-step asks of an episode's graph, be it of ROS 1 or of ROS 2."""

import socket
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Protocol


class Sends(Protocol):
    """A connection that takes messages with their length before them."""

    def send(self, data: bytes, /) -> None:
        """Sends bytes."""
        ...


class Listener(Protocol):
    """A node that listens to one of the robot's topics."""

    @property
    def node(self) -> str:
        """Returns its name."""
        ...

    @property
    def channel(self) -> Sends:
        """Returns what it listens on."""
        ...


class Commander(Protocol):
    """A node that commands the robot."""

    @property
    def sock(self) -> socket.socket:
        """Returns what wakes whoever waits for commands."""
        ...


class GraphSide(Protocol):
    """One episode's nodes and topics, as its robot sees them; ``tasks.ros.graph.graph.Graph`` says what each means."""

    @property
    def busy(self) -> int | bool: ...  # noqa: D102

    @property
    def served(self) -> int: ...  # noqa: D102

    @property
    def changes(self) -> int: ...  # noqa: D102

    @property
    def failure(self) -> str: ...  # noqa: D102

    @property
    def outgoing(self) -> Mapping[str, Sequence[Listener]]: ...  # noqa: D102

    @property
    def incoming(self) -> Sequence[Commander]: ...  # noqa: D102

    @property
    def tags(self) -> dict[str, str]: ...  # noqa: D102

    @property
    def cancelled(self) -> bool: ...  # noqa: D102

    def publish(self, topic: str, data: bytes) -> bool: ...  # noqa: D102

    def keep(self, topic: str, data: bytes) -> None: ...  # noqa: D102

    def take(self) -> list[tuple[str, bytes]]: ...  # noqa: D102

    def nodes(self) -> AbstractSet[str]: ...  # noqa: D102

    def publishers(self, topic: str) -> AbstractSet[str]: ...  # noqa: D102

    def unconnected(self) -> list[str]: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102
