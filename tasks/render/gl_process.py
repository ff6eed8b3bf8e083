"""A process of its own that draws with a GL: found, started, asked, and ended when it hangs.

A GL that does not work may end the interpreter, so nobody draws in his own (docs/reference/rendering.md, section 1).
Such a process says READY and which GL it is, and then answers each line of its standard input with bytes.
"""

import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO, BinaryIO

from specs.errors import SimyardError

_INSTALL = "(Debian: apt-get install libosmesa6, or libegl1 with a GPU)"
NO_GL = f"no 3-D picture: no GL is there {_INSTALL}"
READY = b"GL"
"""What the process says when its GL works; the rest of the line says which it is."""
_GL = "MUJOCO_GL"
ANOTHER_GL = f"set {_GL} to another GL {_INSTALL}"
_BACKENDS = ("egl", "osmesa")
_GL_CHARACTERS = 200
# What Mesa compiles takes it a part of a second, and is not to be left in the user's home.
_UNKEPT = {"MESA_SHADER_CACHE_DISABLE": "true"}
# A process that hangs is ended. One that works starts in seconds; a large picture on a slow machine takes a minute.
_START_S, _ANSWER_S = 120.0, 1200.0


class DrawingFailed(SimyardError):  # noqa: N818 - a state
    """Nothing can be drawn, for which this machine's GL is to blame: there is none, or it ends, or it hangs."""


class DrawingEndedError(RuntimeError):
    """The process ended before it answered, which a GL that works is no reason for."""


class GlProcess:
    """A process that draws.

    Attributes:
        gl: Which GL, for a person.
    """

    def __init__(self, process: subprocess.Popen[bytes], gl: str, complaints: BinaryIO) -> None:
        self.gl = gl
        self.pid = process.pid
        self._process, self._complaints = process, complaints

    def ask(self, what: str, question: bytes, length: int) -> bytes:
        """Returns the answer of the process to a line.

        Args:
            what: Is drawn, for a complaint.
            question: The line, without its end.
            length: How many bytes the answer has.

        Raises:
            DrawingEndedError: It ended.
            DrawingFailed: It does not answer.
        """
        try:
            answer = _ask(self._process, question + b"\n", length, _ANSWER_S)
        except TimeoutError as exc:
            raise DrawingFailed(f"rendering {what} failed: {exc} by {self.gl}; {ANOTHER_GL}") from exc
        if len(answer) < length:
            self._process.wait()
            self._complaints.seek(0)
            raise DrawingEndedError(
                f"rendering {what} failed: {self._complaints.read().decode(errors='replace')[-2000:]}"
            )
        return answer

    def close(self) -> None:
        """Ends it; a second call does nothing."""
        self._process.kill()
        self._process.communicate()
        self._complaints.close()


@contextmanager
def gl_process(module: str, arguments: Sequence[str]) -> Generator[GlProcess | None, None, None]:
    """Yields a process that runs a module, ready to draw; None where no GL is."""
    process = start_gl_process(module, arguments)
    try:
        yield process
    finally:
        if process is not None:
            process.close()


def start_gl_process(
    module: str, arguments: Sequence[str] = (), environment: Mapping[str, str] | None = None
) -> GlProcess | None:
    """Returns a process that draws with the first GL that works: that of MUJOCO_GL, else any; None where none is.

    Args:
        module: As for ``python -m``.
        arguments: Its command line.
        environment: Variables beside this process's.

    Raises:
        DrawingFailed: It says nothing and does not end.
    """
    wanted = {**os.environ, **(environment or {})}.get(_GL)
    for backend in (wanted,) if wanted else _BACKENDS:
        complaints = tempfile.TemporaryFile()  # noqa: SIM115 - the process's, until that is closed
        process = subprocess.Popen(  # noqa: S603 - our own module, and numbers
            [sys.executable, "-P", "-m", module, *arguments],  # -P: a folder tasks where a user stands is not ours
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            env={**_UNKEPT, **os.environ, **(environment or {}), _GL: backend},
        )
        try:
            said = _ask(process, b"", None, _START_S)
        except TimeoutError as exc:
            process.communicate()
            complaints.close()
            raise DrawingFailed(f"the renderer hangs at its start with {_GL}={backend}: {exc}; {ANOTHER_GL}") from exc
        which = f"{backend}: {said.removeprefix(READY).decode().strip()}"
        started = GlProcess(process, which[:_GL_CHARACTERS], complaints)
        if said.startswith(READY):
            return started
        started.close()
    return None


def _ask(process: subprocess.Popen[bytes], question: bytes, length: int | None, limit_s: float) -> bytes:
    """Returns the answer, a line if it has no length; it is shorter when the process has ended.

    Raises:
        TimeoutError: It took longer than the limit, and was ended.
    """
    if process.stdin is None or process.stdout is None:
        return b""
    expired = threading.Event()

    def end() -> None:
        expired.set()
        process.kill()

    watchdog = threading.Timer(limit_s, end)
    watchdog.start()
    try:
        answer = _exchange(process.stdin, process.stdout, question, length)
    finally:
        watchdog.cancel()
    if expired.is_set() and (len(answer) < length if length is not None else not answer.endswith(b"\n")):
        raise TimeoutError(f"no answer within {limit_s:g} s")
    return answer


def _exchange(asked: IO[bytes], said: IO[bytes], question: bytes, length: int | None) -> bytes:
    try:
        asked.write(question)
        asked.flush()
    except BrokenPipeError:
        return b""
    return said.readline() if length is None else said.read(length)
