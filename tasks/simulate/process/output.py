"""What a process prints: its beginning and its end are kept, whatever it prints between."""

import threading
from typing import IO

_HEAD_BYTES, _TAIL_BYTES = 32 << 10, 32 << 10
_LAST_LINES, _LAST_CHARACTERS = 3, 300


class CapturedOutput:
    """Reads all that a process prints, so that it never waits, and keeps both ends of it."""

    def __init__(self, pipe: IO[bytes]) -> None:
        """Begins to read; ends with the pipe."""
        self._pipe, self._lock = pipe, threading.Lock()
        self._head, self._tail, self._left_out = bytearray(), bytearray(), 0
        self._end = bytearray()
        self._thread = threading.Thread(target=self._read, name="simyard output", daemon=True)
        self._thread.start()

    def take(self) -> str:
        """Returns what was printed since this was last asked, with a line where something is left out."""
        with self._lock:
            head, tail, left_out = bytes(self._head), bytes(self._tail), self._left_out
            self._head.clear()
            self._tail.clear()
            self._left_out = 0
        gap = f"\n... {left_out} bytes left out ...\n".encode() if left_out else b""
        return (head + gap + tail).decode("utf-8", "replace")

    def last_lines(self) -> str:
        """Returns the last lines that were printed, as one line; empty if there are none."""
        with self._lock:
            lines = bytes(self._end).decode("utf-8", "replace").split("\n")
        said = " | ".join(" ".join(line.split()) for line in lines if line.strip())
        return " | ".join(said.split(" | ")[-_LAST_LINES:])[-_LAST_CHARACTERS:]

    def wait(self, timeout_s: float) -> None:
        """Returns when the process has closed its output, or after that long."""
        self._thread.join(timeout_s)

    def _read(self) -> None:
        with self._pipe:
            while piece := self._pipe.read1(65536):  # pyright: ignore[reportAttributeAccessIssue] - a buffered reader
                with self._lock:
                    self._keep(piece)

    def _keep(self, piece: bytes) -> None:
        room = _HEAD_BYTES - len(self._head) if not self._tail else 0
        self._head += piece[:room]
        self._tail += piece[room:]
        over = len(self._tail) - _TAIL_BYTES
        if over > 0:
            del self._tail[:over]
            self._left_out += over
        self._end = (self._end + piece)[-4 * _LAST_CHARACTERS :]
