"""How many connections are open at once, in all and from one address.

Whoever is one too many takes the place of the connection that has waited longest without a whole request: a thousand
half-open ones keep nobody out. Only if all of them are being answered is the new one turned away.
"""

from ipaddress import ip_address, ip_network
from typing import NamedTuple, Protocol


class Bounds(NamedTuple):
    """What connections may take.

    Attributes:
        open: Connections at once.
        of_client: Those from one address; from one /64 network of IPv6.
        head_s: Until the head of a request is there, and until TLS is agreed on.
        request_s: Until all of it is there.
        answer_s: Until a client has read some of an answer that waits for it.
        idle_s: Between an answer and the next request.
    """

    open: int = 512
    of_client: int = 256
    head_s: float = 10
    request_s: float = 60
    answer_s: float = 60
    idle_s: float = 20


class Connection(Protocol):
    """A connection that can be ended."""

    def drop(self) -> None:
        """Ends it at once."""
        ...


class Connections:
    """The open connections of one server; used by the thread of its event loop alone."""

    def __init__(self, bounds: Bounds) -> None:
        """Begins with none."""
        self.bounds = bounds
        self._clients: dict[Connection, str] = {}
        self._waiting: dict[Connection, None] = {}  # the longest first
        self._counts: dict[str, int] = {}

    def __len__(self) -> int:
        """Returns how many there are."""
        return len(self._clients)

    def admit(self, connection: Connection, address: str) -> bool:
        """Returns whether there is room for a new connection, which waits for a request then."""
        client = _network(address)
        full = self._counts.get(client, 0) >= self.bounds.of_client
        if (full or len(self) >= self.bounds.open) and not self._make_room(client if full else None):
            return False
        self._clients[connection] = client
        self._counts[client] = self._counts.get(client, 0) + 1
        self.wait(connection)
        return True

    def wait(self, connection: Connection) -> None:
        """Notes that a connection has no whole request from now on."""
        if connection in self._clients:
            self._waiting.pop(connection, None)
            self._waiting[connection] = None

    def busy(self, connection: Connection) -> None:
        """Notes that a request is there, which is to be answered."""
        self._waiting.pop(connection, None)

    def forget(self, connection: Connection) -> None:
        """Notes that a connection has ended."""
        self._waiting.pop(connection, None)
        client = self._clients.pop(connection, None)
        if client is not None:
            self._counts[client] -= 1
            if not self._counts[client]:
                del self._counts[client]

    def _make_room(self, client: str | None) -> bool:
        """Ends the connection that has waited longest, of one client or of all."""
        for each in self._waiting:
            if client in {None, self._clients[each]}:
                self.forget(each)
                each.drop()
                return True
        return False


def _network(address: str) -> str:
    try:
        parsed = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if parsed.version == 4:
        return address
    return str(parsed.ipv4_mapped or ip_network((parsed, 64), strict=False))
