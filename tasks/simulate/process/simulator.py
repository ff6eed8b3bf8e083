"""A process that simulates: asked for one thing at a time, watched meanwhile, and ended when it hangs."""

import mmap
import os
import select
import signal
import socket
import subprocess
import tempfile
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
from tasks.simulate.application.call_clock import CLOCK_BYTES, RunningCall, running_call
from tasks.simulate.chunk.timings import remember_timing
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.process.compilations import Compilations
from tasks.simulate.process.confinement import confined_command, confined_environment, programs_folder
from tasks.simulate.process.limits import overdue
from tasks.simulate.process.output import CapturedOutput
from tasks.simulate.process.wire import Message, MessageRefused, receive, send
from tasks.simulate.process.work import (
    ANSWER,
    AgainWork,
    Answer,
    Audited,
    AuditWork,
    Compiles,
    Defect,
    LanesWork,
    Progress,
    Ready,
    RecordingBegins,
    RecordingEnds,
    Rows,
    Samples,
    SentWorlds,
)

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
        self._chunks: dict[int, tuple[EpisodeRequest, ...]] = {}
        with tempfile.TemporaryFile(prefix="simyard-calls-") as file:
            file.truncate(CLOCK_BYTES)
            self._calls = mmap.mmap(file.fileno(), CLOCK_BYTES)
            self._connection, theirs = socket.socketpair()
            with theirs:
                self._process = _starter.submit(_started, self.bundles, theirs, file).result()
        self._connection.settimeout(_MESSAGE_S)
        self._poll = select.poll()
        self._poll.register(self._connection, select.POLLIN)
        assert self._process.stdout is not None  # noqa: S101 - asked for
        self.output, self._compilations = CapturedOutput(self._process.stdout), Compilations()
        self._ready, self._knows_ahead, self._beside_others = False, False, False

    @property
    def alive(self) -> bool:
        """Returns whether it can be asked."""
        return self._process.poll() is None

    def ask(
        self,
        work: LanesWork | AuditWork | AgainWork,
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
        ahead = isinstance(work, LanesWork) and len(work.numbers) > 1
        before, self._knows_ahead = self._knows_ahead, ahead
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
        gone = tuple(self._worlds)[: max(0, len(self._worlds) - max(_WORLDS_KEPT, len(worlds)))]
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
        return self.broke_off(f"it answered what is no answer: {str(answer)[:200]!r}")

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
        self.output.wait(1.0)

    def _asked(
        self, work: LanesWork | AuditWork | AgainWork, on_answer: OnAnswer, should_stop: Callable[[], bool]
    ) -> Told:
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
            if (call := running_call(self._calls)) and (why := overdue(call)):
                raise self._ended_for(why, "limit", call)

    def _await_ready(self) -> None:
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
            message = receive(self._connection)
            answer = ANSWER.validate_python(message.document)
        except (EOFError, OSError):
            raise self._ended() from None
        except (MessageRefused, ValidationError) as exc:
            raise self.refused(exc) from None
        if isinstance(answer, Rows | Audited):
            for each in answer.timings:
                remember_timing(each.program, each.timing)
        if isinstance(answer, Defect):
            raise SimulatorDefect(answer.text)
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


class SimulatorDefect(RuntimeError):  # noqa: N818 - what it is
    """The process met an exception that no application caused: a defect of Simyard's, with its traceback as a note."""

    def __init__(self, text: str) -> None:
        super().__init__(text.strip().rpartition("\n")[2])
        self.add_note(text)


def _started(bundles: Mapping[str, Path], connection: socket.socket, calls: IO[bytes]) -> subprocess.Popen[bytes]:
    handles = (connection.fileno(), calls.fileno())
    programs = programs_folder(bundles)
    command = confined_command(["-m", _MODULE, *map(str, handles)], programs, bundles.values())
    return subprocess.Popen(  # noqa: S603 - of this package's making
        command,
        env=confined_environment(os.environ, programs),
        cwd=tempfile.gettempdir(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        pass_fds=handles,
        start_new_session=True,  # so that an interrupt at the terminal reaches the run, which ends it
    )
