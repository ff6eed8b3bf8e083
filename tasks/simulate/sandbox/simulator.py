"""A process that simulates: asked for one thing at a time, watched meanwhile, and ended when it hangs.

A call of an application's code may take so long by a clock on the wall. Of what the process prints, the beginning and
the end are kept. Whoever listens to progress hears which programs it compiles, seconds in which no episode goes on.
"""

import mmap
import os
import select
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import IO, Literal

import numpy as np
from pydantic import ValidationError

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from specs.errors import SimyardError
from specs.settings import IMPORT_LIMIT, STEP_LIMIT
from tasks.progress.listener import report_progress
from tasks.simulate.application.bundle_code import CLOCK_BYTES, CallKind, RunningCall, running_call
from tasks.simulate.chunk.byproducts import note_timing
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.sandbox.confinement import Place, confined_command, programs_folder, require_confined
from tasks.simulate.sandbox.process_environment import process_environment
from tasks.simulate.sandbox.protocol import (
    ANSWER,
    READY,
    Answer,
    Audited,
    Compiles,
    Defect,
    LanesWork,
    Message,
    MessageRefused,
    PicturesWork,
    Progress,
    Question,
    Ready,
    RecordingBegins,
    RecordingEnds,
    Rows,
    Samples,
    SentWorlds,
    answer_bounds,
    receive,
    send,
)

# Compiling the largest program takes minutes on a slow machine; nobody waits for it an hour.
_COMPILE_LIMIT_S = 3600.0
# Lock-step ends an application that hangs by itself, after seconds; starting those of many lanes takes minutes.
_NODES_LIMIT_S = 900.0


def timeout_of(call: RunningCall) -> str:
    """Returns that a call takes too long, for a person; empty as long as it does not."""
    limits: Mapping[CallKind, tuple[float, str]] = {
        "import": (IMPORT_LIMIT.value(), "SIMYARD_IMPORT_LIMIT_S"),
        "call": (STEP_LIMIT.value(), "SIMYARD_STEP_LIMIT_S"),
        "slice": (STEP_LIMIT.value(), "SIMYARD_STEP_LIMIT_S"),
        "compile": (max(_COMPILE_LIMIT_S, STEP_LIMIT.value()), "SIMYARD_STEP_LIMIT_S"),
        "nodes": (max(_NODES_LIMIT_S, STEP_LIMIT.value()), "SIMYARD_STEP_LIMIT_S"),
    }
    limit_s, name = limits[call.kind]
    return f"{call.what} took longer than {limit_s:g} s ({name})" if call.seconds > limit_s else ""


_HEAD_BYTES, _TAIL_BYTES = 32 << 10, 32 << 10
_PIPE_BYTES = 1 << 20  # more than any pipe holds (pipe(7), /proc/sys/fs/pipe-max-size)
_LAST_LINES, _LAST_CHARACTERS = 3, 300


class CapturedOutput:
    """Reads all that a process prints, so that it never waits, and keeps both ends of it."""

    def __init__(self, pipe: IO[bytes]) -> None:
        """Begins to read; ends with the pipe."""
        self._pipe, self._lock, self._ended = pipe, threading.Lock(), False
        os.set_blocking(pipe.fileno(), False)
        self._head, self._tail, self._left_out = bytearray(), bytearray(), 0
        self._end = bytearray()
        self._thread = threading.Thread(target=self._read, name="simyard output", daemon=True)
        self._thread.start()

    def take(self) -> str:
        """Returns what was printed since this was last asked, with a line where something is left out.

        What the process printed before it answered is there, whether or not the thread has come to read it.
        """
        with self._lock:
            self._keep_waiting()
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
        poll = select.poll()
        with self._pipe:
            poll.register(self._pipe, select.POLLIN)
            while not self._ended:
                poll.poll()
                with self._lock:
                    self._keep_waiting()

    def _keep_waiting(self) -> None:
        """Keeps what waits in the pipe, at once and only once: who prints without end holds nobody up."""
        if self._ended:
            return
        try:
            piece = os.read(self._pipe.fileno(), _PIPE_BYTES)
        except BlockingIOError:  # nothing, or the other of both who read has it
            return
        self._ended = not piece
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


COMPILATION_STAGE = "Compilation"
# A process has a few programs; what an application has it say beyond that is not shown.
_MOST_COMPILATIONS = 64


class Compilations:
    """Counts the programs of a process."""

    def __init__(self) -> None:
        """Begins without programs."""
        self._begun = self._ended = 0

    def hear(self, answer: Answer) -> None:
        """Tells the listener of this context when a program begins to be compiled, and when it is there."""
        if self._ended < self._begun:
            self._ended = self._begun
            report_progress(COMPILATION_STAGE, self._ended, self._begun)
        if isinstance(answer, Compiles) and self._begun < _MOST_COMPILATIONS:
            self._begun += 1
            report_progress(COMPILATION_STAGE, self._ended, self._begun)


_LOOK_S = 0.2
_START_S = 120.0
# From being told to stop until it is ended; a slice takes seconds at most.
_GRACE_S = 10.0
# Within a message; only a process that was stopped takes that long.
_MESSAGE_S = 120.0
_WORLDS_KEPT = 256
_MODULE = "tasks.simulate.simulation_process"
Told = tuple[Answer, tuple[np.ndarray, ...]]
OnAnswer = Callable[[Answer, tuple[np.ndarray, ...]], None]
Killed = Literal["", "limit", "stop"]
_BETWEEN = (Progress, Compiles, RecordingBegins, Samples, RecordingEnds)


# The kernel ends a process with the thread that started it: this one lives as long as the run.
_starter = ThreadPoolExecutor(1, "simyard simulators")


def _ignore(_answer: Answer, _arrays: tuple[np.ndarray, ...]) -> None:
    """Does nothing with an answer before the last."""


class SimulatorEnded(SimyardError):  # noqa: N818 - a state
    """The process that simulates ended before it answered.

    Attributes:
        code: RoboMaker's failure code of the application whose code it was in; empty where it was in nobody's.
        importing: Whether it was importing an application.
        reason: How it ended, while doing what, and what it printed last, for a person.
        killed: ``limit`` if a call took too long, ``stop`` if it was told to stop and did not.
        out_of_memory: Whether it ended as the kernel ends a process for want of memory, in no application's code.
        beside_others: Whether it knew of chunks ahead, whose episodes may be to blame.
    """

    beside_others = False

    def __init__(
        self, how: str, call: RunningCall | None, printed: str, *, killed: Killed = "", status: int = 0
    ) -> None:
        self.code = call.code if call else ""
        self.importing = call is not None and call.kind == "import"
        self.killed: Killed = killed
        self.out_of_memory = not killed and status == -signal.SIGKILL and not self.code
        during = f" during {call.what}" if call and not killed else ""
        self.reason = f"{how}{during}{f'; it printed last: {printed}' if printed else ''}"
        super().__init__(self.reason)


class Simulator:
    """A process that simulates with certain applications."""

    def __init__(self, bundles: Mapping[str, Path]) -> None:
        """Starts it.

        Args:
            bundles: Unpacked folders of the applications, by digest.
        """
        self.bundles = dict(bundles)
        self._worlds: dict[str, World] = {}
        self._room = _WORLDS_KEPT
        self._chunks: dict[int, tuple[EpisodeRequest, ...]] = {}
        with tempfile.TemporaryFile(prefix="simyard-calls-") as file:
            file.truncate(CLOCK_BYTES)
            self._calls = mmap.mmap(file.fileno(), CLOCK_BYTES)
            self._connection, theirs = socket.socketpair()
            self._folder = tempfile.TemporaryDirectory(prefix="simyard-simulator-", ignore_cleanup_errors=True)
            with theirs:
                self._process = _starter.submit(_started, self.bundles, Path(self._folder.name), theirs, file).result()
        self._connection.settimeout(_MESSAGE_S)
        self._poll = select.poll()
        self._poll.register(self._connection, select.POLLIN)
        assert self._process.stdout is not None  # noqa: S101 - asked for
        self.output, self._compilations = CapturedOutput(self._process.stdout), Compilations()
        self._ready, self._knows_ahead, self._beside_others, self._bounds = False, False, False, READY

    @property
    def alive(self) -> bool:
        """Returns whether it can be asked."""
        return self._process.poll() is None

    def ask(
        self,
        work: Question,
        *,
        on_answer: OnAnswer = _ignore,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Told:
        """Returns the last answer to a question, and its arrays.

        Args:
            work: The question.
            on_answer: Given each answer before the last.
            should_stop: Asked several times a second; lanes that are not done when it says so are Canceled.

        Raises:
            SimulatorEnded: The process ended, took too long over a call, or answered what is no answer.
            SimulatorDefect: It met a defect.
        """
        first = self._chunks.get(work.numbers[0], ()) if isinstance(work, LanesWork) else ()
        self._bounds = answer_bounds(work, first)
        ahead = isinstance(work, LanesWork) and len(work.numbers) > 1
        before = self._knows_ahead
        self._knows_ahead = before if isinstance(work, PicturesWork) else ahead
        self._beside_others = before or ahead
        try:
            return self._asked(work, on_answer, should_stop)
        except SimulatorEnded as ended:
            self.end()
            ended.beside_others = self._beside_others
            raise
        except BaseException:  # also an interrupt: what it answers later is no answer to another question
            self.end()
            raise

    def sent_worlds(self, worlds: Mapping[str, World]) -> SentWorlds:
        """Returns what the process has to be sent of some worlds; it keeps those that it got last."""
        new = {name: world.model_dump_json() for name, world in worlds.items() if self._worlds.get(name) is not world}
        for name, world in worlds.items():
            self._worlds.pop(name, None)
            self._worlds[name] = world
        self._room = max(self._room, len(worlds))  # a question about one must not take away those of chunks ahead
        gone = tuple(self._worlds)[: max(0, len(self._worlds) - self._room)]
        for name in gone:
            del self._worlds[name]
        return SentWorlds(new=new, gone=gone)

    def new_chunks(self, chunks: Sequence[Chunk]) -> tuple[Chunk, ...]:
        """Returns those of some chunks that the process has to be sent; it keeps those of the last question."""
        new = tuple(chunk for chunk in chunks if self._chunks.get(chunk.number) is not chunk.requests)
        self._chunks = {chunk.number: chunk.requests for chunk in chunks}
        return new

    def refused(self, answer: Exception) -> SimulatorEnded:
        """Ends the process, whose answer is none, and returns how it ended."""
        call = running_call(self._calls)
        during = f" during {call.what}" if call else ""
        return self.broke_off(f"the process that simulates answered what is no answer{during}: {str(answer)[:200]!r}")

    def broke_off(self, why: str) -> SimulatorEnded:
        """Ends the process, which did not answer as it has to, and returns how it ended."""
        ended = self._ended_for(why, "limit")
        ended.beside_others = self._beside_others
        return ended

    def end(self) -> None:
        """Ends the process, with all that it has started."""
        self._connection.close()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._folder.cleanup()
        self.output.wait(1.0)

    def _asked(self, work: Question, on_answer: OnAnswer, should_stop: Callable[[], bool]) -> Told:
        if not self._ready:
            self._await_ready()
        try:
            send(self._connection, {"work": work.model_dump_json()})
        except OSError:
            raise self._ended() from None
        stop_s: float | None = None
        while True:
            answer, message = self._next_answer(time.monotonic() + _LOOK_S)
            if answer is not None:
                self._compilations.hear(answer)
                if not isinstance(answer, _BETWEEN):
                    return answer, message.arrays
                if not isinstance(answer, Compiles):
                    on_answer(answer, message.arrays)
            if stop_s is None and should_stop():
                stop_s = time.monotonic()
                with suppress(OSError):
                    send(self._connection, {"stop": True})
            elif stop_s is not None and time.monotonic() - stop_s > _GRACE_S:
                raise self._ended_for("it did not stop when it was told to", "stop")
            if (call := running_call(self._calls)) and (why := timeout_of(call)):
                raise self._ended_for(why, "limit", call)

    def _await_ready(self) -> None:
        """Waits until the process has imported all that is Simyard's.

        Raises:
            SimulatorNotStarted: It ended before: no application was imported, so none is to blame.
            SimulatorEnded: It ended for want of memory.
        """
        try:
            self._await_first_answer()
        except SimulatorEnded as ended:
            if ended.out_of_memory:
                raise
            raise SimulatorNotStarted(ended.reason) from ended

    def _await_first_answer(self) -> None:
        end_s = time.monotonic() + _START_S
        while not self._ready:
            answer, _ = self._next_answer(end_s)
            if answer is None:
                raise self._ended_for(f"it did not start within {_START_S:g} s", "limit")
            self._ready = isinstance(answer, Ready)

    def _next_answer(self, until_s: float) -> tuple[Answer | None, Message]:
        """Returns the next answer, or None if there is none until then."""
        if not self._poll.poll(1000.0 * max(0.0, until_s - time.monotonic())):
            return None, Message({})
        try:
            message = receive(self._connection, self._bounds if self._ready else READY)
            answer = ANSWER.validate_python(message.document)
        except (EOFError, OSError):
            raise self._ended() from None
        except (MessageRefused, ValidationError) as exc:
            raise self.refused(exc) from None
        if isinstance(answer, Rows | Audited):
            for each in answer.timings:
                note_timing(each)
        if isinstance(answer, Defect):
            raise SimulatorDefect(answer)
        return answer, message

    def _ended(self) -> SimulatorEnded:
        """Returns how the process ended by itself."""
        try:
            status = self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            return self._ended_for("it closed its connection", "limit")
        self.output.wait(1.0)
        status = -(status - 128) if status > 128 else status  # as bubblewrap tells of a signal
        how = f"was ended by signal {-status}" if status < 0 else f"ended with exit code {status}"
        call = running_call(self._calls)
        return SimulatorEnded(f"the process {how}", call, self.output.last_lines(), status=status)

    def _ended_for(self, why: str, killed: Killed, call: RunningCall | None = None) -> SimulatorEnded:
        self.end()
        return SimulatorEnded(why, call or running_call(self._calls), self.output.last_lines(), killed=killed)


class SimulatorNotStarted(SimyardError):  # noqa: N818 - a state
    """The process that simulates ended before it could import an application: this machine is to blame."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"the process that simulates does not start on this machine: {reason}; no application ran, so nothing was "
            "judged: look at what is installed here and at the variables of docs/operate/operations.md, Environment"
        )


class SimulatorDefect(RuntimeError):  # noqa: N818 - what it is
    """The process met an exception that no application caused: a defect of Simyard's, with its traceback as a note."""

    def __init__(self, defect: Defect) -> None:
        super().__init__(defect.reason)
        self.add_note(defect.text)


def _started(
    bundles: Mapping[str, Path], folder: Path, connection: socket.socket, calls: IO[bytes]
) -> subprocess.Popen[bytes]:
    require_confined(bundles.values())
    handles = (connection.fileno(), calls.fileno())
    place = Place(programs_folder(bundles), folder)
    command = confined_command(_MODULE, [*map(str, handles)], place, bundles.values())
    return subprocess.Popen(  # noqa: S603 - of this package's making
        command,
        env=process_environment(os.environ, place.programs) | place.variables(),
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        pass_fds=handles,
        start_new_session=True,  # so that an interrupt at the terminal reaches the run, which ends it
    )
