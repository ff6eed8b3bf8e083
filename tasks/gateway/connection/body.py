"""The body of a request while it arrives: bounded for each, and for all together."""

from collections.abc import Awaitable, Callable, Generator, MutableMapping, Sequence
from contextlib import contextmanager
from typing import Any

from specs.errors import AccessRefused

_SMALL_BYTES = 64 << 10
_ROOM_BYTES = 128 << 20
_MOST_HEADERS = 100
_TOO_BIG = "RequestEntityTooLargeException"
_Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]


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
            if len(found) > max(_SMALL_BYTES, self.taken):
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
