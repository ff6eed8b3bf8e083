"""uvicorn's HTTP for strangers: bounded in number, and cut off where a client is slow.

uvicorn alone waits for ever for the head of a request, for its body, and for who does not read an answer.
"""

import asyncio
import ssl
from typing import Any, Literal

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from tasks.gateway.connection.connections import Connections

_SLICE_BYTES = 8 << 10
_GRACE_S = 5
_FULL_BODY = b'{"message": "too many connections"}'
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: application/json\r\nretry-after: 1\r\nconnection: close\r\n"
    b"x-amzn-errortype: ServiceUnavailableException\r\ncontent-length: %d\r\n\r\n%s"
) % (len(_FULL_BODY), _FULL_BODY)
_Await = Literal["", "head", "body", "next"]


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
