"""Connections of clients: how many are open, how slow and how big they may be, and how they are encrypted.

uvicorn alone waits for ever for the head of a request, for its body, and for who does not read an answer: here a
connection that is slow is cut off.
"""

import asyncio
import socket
import ssl
from collections.abc import Awaitable, Callable, Generator, MutableMapping, Sequence
from contextlib import contextmanager
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from specs.errors import AccessRefused, DocumentError

SMALL_BYTES = 64 << 10
_ROOM_BYTES = 128 << 20
_MOST_HEADERS = 100
_TOO_BIG = "RequestEntityTooLargeException"
_Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
_SLICE_BYTES = 8 << 10
_GRACE_S = 5
_FULL_BODY = b'{"message": "too many connections"}'
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: application/json\r\nretry-after: 1\r\nconnection: close\r\n"
    b"x-amzn-errortype: ServiceUnavailableException\r\ncontent-length: %d\r\n\r\n%s"
) % (len(_FULL_BODY), _FULL_BODY)
_Await = Literal["", "head", "body", "next"]
_WAITING = 512
"""Connections that the kernel keeps while the gateway has no time for them."""


# Whoever is one too many takes the place of the connection that has waited longest without a whole request: a
# thousand half-open ones keep nobody out. Only if all of them are being answered is the new one turned away.
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
        client = network_of(address)
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


def network_of(address: str) -> str:
    """Returns what is one client: an address, or a /64 network of IPv6."""
    try:
        parsed = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if parsed.version == 4:
        return address
    return str(parsed.ipv4_mapped or ip_network((parsed, 64), strict=False))


class BodyRoom:
    """The memory that bodies take which have arrived and are not answered; used by the event loop's thread alone.

    Small bodies always have room: there are only as many as there are connections.
    """

    def __init__(self, room_bytes: int = _ROOM_BYTES) -> None:
        """Begins empty."""
        self._free = room_bytes

    @contextmanager
    def place(self) -> Generator["BodyPlace"]:
        """Makes a place for one body until it is answered."""
        place = BodyPlace(self)
        try:
            yield place
        finally:
            self._free += place.taken

    def take(self, count: int) -> None:
        """Takes bytes of the room.

        Raises:
            AccessRefused: So many are not free.
        """
        if count > self._free:
            raise AccessRefused("ServiceUnavailableException", "too many large requests at once; try it again", 503)
        self._free -= count


class BodyPlace:
    """The part of the room that one body takes."""

    def __init__(self, room: BodyRoom) -> None:
        """Begins empty."""
        self._room = room
        self.taken = 0

    async def read(self, receive: _Receive, most_bytes: int) -> bytes | None:
        """Returns the whole body; None if the client went away.

        Raises:
            AccessRefused: It has more bytes than that, or there is no room for it now.
        """
        found = bytearray()
        while True:
            message = await receive()
            if message["type"] != "http.request":
                return None
            found += message.get("body", b"")
            if len(found) > most_bytes:
                raise too_big(most_bytes)
            if len(found) > max(SMALL_BYTES, self.taken):
                # Twice as much each time, so that few steps lead to the end.
                more = min(max(len(found), 2 * self.taken), most_bytes) - self.taken
                self._room.take(more)
                self.taken += more
            if not message.get("more_body", False):
                return bytes(found)


def check_head(headers: Sequence[tuple[str, str]], most_bytes: int) -> None:
    """Passes if what the head of a request says of its size is within bounds.

    Raises:
        AccessRefused: It is not, or the head does not say how long the body is.
    """
    if len(headers) > _MOST_HEADERS:
        raise AccessRefused("RequestHeaderSectionTooLarge", f"a request has at most {_MOST_HEADERS} headers", 431)
    if any(name == "transfer-encoding" for name, _ in headers):
        raise AccessRefused("LengthRequiredException", "send Content-Length; bodies in chunks are not taken", 411)
    lengths = [value for name, value in headers if name == "content-length"]
    if any(len(value) > 15 or int(value) > most_bytes for value in lengths):
        raise too_big(most_bytes)


def too_big(most_bytes: int) -> AccessRefused:
    """Returns the refusal of a body that is too big."""
    return AccessRefused(_TOO_BIG, f"a request has at most {most_bytes:,} bytes", 413)


class BoundedProtocol(H11Protocol):
    """One connection.

    Args:
        connections: All that are open.
        tls: How it is encrypted; None if it is not.
    """

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
        *,
        all_connections: Connections,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._all, self._bounds, self._tls = all_connections, all_connections.bounds, tls
        self._raw: asyncio.Transport | None = None
        self._agreement: asyncio.Task[None] | None = None
        self._begun, self._early = False, b""
        self._awaited: _Await = ""
        self._timer: asyncio.TimerHandle | None = None
        self._reader: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Counts a new connection; answers it once it is encrypted."""
        peer = transport.get_extra_info("peername") or ("",)
        if not self._all.admit(self, str(peer[0])):
            if self._tls is None:
                transport.write(_FULL)
            transport.close()
            return
        self._raw = transport
        if self._tls is None:
            self._begin(transport)
        else:
            self._agreement = self.loop.create_task(self._agree(transport, self._tls))

    def data_received(self, data: bytes) -> None:
        """Reads a part of a request."""
        if not self._begun:  # sent with the last words of the agreement
            self._early += data
            return
        for start in range(0, len(data), _SLICE_BYTES):
            super().data_received(data[start : start + _SLICE_BYTES])
            if self._is_chunked():
                # The application refuses it. Thousands of chunks of a byte would hold up everybody until then.
                self.flow.pause_reading()
                break
            if self.transport.is_closing():
                return
        self._watch()

    def on_response_complete(self) -> None:
        """Waits for the next request, or for the client to read the answer."""
        super().on_response_complete()
        if self.transport.is_closing():
            self._await("")
            self._expect_reader()
        elif self.conn.their_state is h11.IDLE and not self.conn.trailing_data[0]:
            self._all.wait(self)
            self._await("next", self._bounds.idle_s + _GRACE_S)  # uvicorn's own timer is first
        else:
            self._awaited = ""
            self._watch()

    def pause_writing(self) -> None:
        """Waits for the client to read."""
        super().pause_writing()
        self._expect_reader()

    def resume_writing(self) -> None:
        """Goes on: the client has read."""
        super().resume_writing()
        if not self.transport.is_closing():
            self._forget_reader()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forgets the connection."""
        self._await("")
        self._forget_reader()
        self._all.forget(self)
        if self._begun:
            super().connection_lost(exc)

    def drop(self) -> None:
        """Ends the connection at once."""
        if self._raw is not None:
            self._raw.abort()

    def _begin(self, transport: asyncio.Transport) -> None:
        self._begun = True
        super().connection_made(transport)
        self._await("head", self._bounds.head_s)

    async def _agree(self, transport: asyncio.Transport, tls: ssl.SSLContext) -> None:
        try:
            secure = await self.loop.start_tls(
                transport, self, tls, server_side=True, ssl_handshake_timeout=self._bounds.head_s
            )
        except (OSError, asyncio.CancelledError):  # ssl.SSLError is an OSError
            self._all.forget(self)
            transport.abort()
            return
        if secure is None or secure.is_closing():
            self._all.forget(self)
            return
        self._begin(secure)
        early, self._early = self._early, b""
        if early:
            self.data_received(early)

    def _watch(self) -> None:
        """Sees to it that what a client has begun comes to its end."""
        state = self.conn.their_state
        if state is h11.IDLE:
            if self._awaited != "head":
                self._all.wait(self)
                self._await("head", self._bounds.head_s)
        elif state is h11.SEND_BODY:
            if self._awaited != "body":
                self._await("body", self._bounds.request_s)
        else:
            self._all.busy(self)
            if self._awaited in {"head", "body", "next"}:
                self._await("")

    def _await(self, awaited: _Await, at_most_s: float = 0) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._awaited = awaited
        self._timer = self.loop.call_later(at_most_s, self.drop) if awaited else None

    def _expect_reader(self) -> None:
        if self._reader is None:
            self._reader = self.loop.call_later(self._bounds.answer_s, self.drop)

    def _forget_reader(self) -> None:
        if self._reader is not None:
            self._reader.cancel()
            self._reader = None

    def _is_chunked(self) -> bool:
        sends = self.conn.their_state is h11.SEND_BODY
        return sends and any(name == b"transfer-encoding" for name, _ in self.headers)


def bound_socket(host: str, port: int) -> socket.socket:
    """Returns a socket that is bound to an address and listens.

    Raises:
        DocumentError: Another program listens there, or this machine has no such address.
    """
    # asyncio sends small answers at once only where the socket says that it is TCP's: 1 ms and not 45.
    bound = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((host.strip("[]"), port))
        bound.listen(_WAITING)
    except OSError as exc:
        bound.close()
        option, value = ("--host", host) if isinstance(exc, socket.gaierror) else ("--port", str(port))
        allowed = f"an address of this machine and a port that is free: {exc.strerror or exc}"
        raise DocumentError.of(option, repr(value), allowed) from exc
    return bound


def tls_context(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    """Returns how to encrypt, TLS 1.2 or later; None if neither file is named.

    Raises:
        DocumentError: One of them is missing, cannot be read, or they do not belong to each other.
    """
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        raise _refused("--tls-certificate and --tls-key, both or neither")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except (OSError, ValueError) as exc:  # ssl.SSLError is an OSError
        raise _refused(f"PEM files that belong to each other, the key without a password: {exc}") from exc
    return context


def _no_password() -> str:
    # Without this, OpenSSL would ask the terminal, and a service has none.
    raise ValueError("the key has a password")


def _refused(allowed: str) -> DocumentError:
    return DocumentError.of("TLS", "certificate and key", allowed, source="simyard serve")
