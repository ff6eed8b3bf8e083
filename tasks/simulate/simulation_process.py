"""The process that simulates: it alone imports applications, and what it is asked it answers.

Run as ``python -m tasks.simulate.simulation_process CONNECTION CALLS``, with two file descriptors: a socket to whoever
started it, and the memory in which it notes which call of an application is under way.
"""

import contextlib
import ctypes
import importlib
import io
import mmap
import os
import select
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Int

from specs.base import Spec
from specs.data.column_bytes import encode_columns
from specs.data.episode import EpisodeResult
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.application.bundle_code import CLOCK_BYTES, BundleCrash, CallWatchdog, use_watchdog
from tasks.simulate.chunk.byproducts import collect_tags, collect_timings
from tasks.simulate.devices import prepare_devices
from tasks.simulate.lane.recording import Ends, RecordingChoice, SliceSamples, Steps, sample_stride, slice_samples
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.sandbox.protocol import (
    QUESTION,
    TEXT_CHARACTERS,
    WORK,
    Audited,
    AuditWork,
    Compiles,
    Crashed,
    Defect,
    LanesWork,
    NoMemory,
    PicturesWork,
    Progress,
    Question,
    Ready,
    RecordingBegins,
    RecordingEnds,
    ReplayWork,
    Rows,
    Samples,
    SentWorlds,
    receive,
    send,
)

if TYPE_CHECKING:
    from tasks.simulate.chunk.chunk_pipeline import ChunkPipeline

_PR_SET_PDEATHSIG = 1
# So few episodes, in so small a part of the lanes, are driven soonest by themselves, as an audit's are: no lane is
# refilled for them, and the programs that refill lanes take longer to load than they take to drive.
_NARROW = 4
_Say = Callable[[Spec, Sequence[np.ndarray]], None]
PROGRAMS = "SIMYARD_PROGRAMS"
"""Where it is ``trace``, each process traces its programs anew."""


def main(connection: socket.socket, calls: int) -> None:
    """Answers question after question, until whoever asks is gone.

    Args:
        connection: To whoever asks.
        calls: File descriptor of the memory for calls.
    """
    use_watchdog(CallWatchdog(mmap.mmap(calls, CLOCK_BYTES)))
    prepare_devices()
    with contextlib.redirect_stdout(io.StringIO()):  # MJX prints that its optional Warp backend is missing
        importlib.import_module(
            "tasks.simulate.chunk.chunk_simulation"
        )  # which imports JAX, which reads its settings then
    _find_devices()
    service = Service(connection)
    _keep_programs(service.compiles)
    service.say(Ready())
    while True:
        while not service.asked() and service.work_ahead():
            pass
        try:
            document = receive(connection, QUESTION).document
        except (EOFError, OSError):
            return
        if "work" in document:  # else it is told to stop what it has ended already
            service.answer(WORK.validate_json(str(document["work"])))


def _find_devices() -> None:
    """Has JAX find its devices, before there is an application that could be blamed if it cannot."""
    import jax  # noqa: PLC0415 - after its settings

    jax.devices()


def _keep_programs(on_compile: Callable[[], None]) -> None:
    """Lets programs be kept for processes to come, where those of these applications alone are, unless told not to."""
    from tasks.simulate.engines.program_cache import use_cache_folder  # noqa: PLC0415 - after JAX's settings

    if os.environ.get(PROGRAMS, "") != "trace":
        use_cache_folder(Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "kept", on_compile)


class Service:
    """Answers questions over a connection."""

    def __init__(self, connection: socket.socket) -> None:
        """Begins without worlds."""
        self._connection, self._worlds, self._chunks = connection, dict[str, World](), dict[int, Chunk]()
        self._stopped, self._poll, self._asked = False, select.poll(), False
        self._pipeline: ChunkPipeline | None = None
        self._poll.register(connection, select.POLLIN)

    def asked(self) -> bool:
        """Returns whether a question waits."""
        return bool(self._poll.poll(0))

    def work_ahead(self) -> bool:
        """Simulates a slice of what is going to be asked for; returns False if nothing is known of that."""
        return self._pipeline is not None and self._pipeline.work_ahead()

    def compiles(self) -> None:
        """Tells whoever asks that a program is compiled, which may take minutes; of what nobody waits for, nothing."""
        if self._asked and threading.current_thread() is threading.main_thread():  # answers have one sender
            self.say(Compiles())

    def say(self, answer: Spec, arrays: Sequence[np.ndarray] = ()) -> None:
        """Sends an answer."""
        send(self._connection, answer.model_dump_json(), arrays)

    def answer(self, work: Question) -> None:
        """Answers a question, whatever happens."""
        self._stopped, self._asked = False, True
        self._keep(work.worlds)
        try:
            self._work(work)
        except BundleCrash as crash:
            self.say(Crashed(code=crash.code, reason=crash.reason))
        except MemoryError as exc:
            self.say(NoMemory(text=str(exc)[-TEXT_CHARACTERS:]))
        except Exception as exc:  # noqa: BLE001 - whoever asks raises it
            if "RESOURCE_EXHAUSTED" in str(exc):  # XLA's status for an allocation that failed
                self.say(NoMemory(text=str(exc)[-TEXT_CHARACTERS:]))
            else:
                reason = f"{type(exc).__name__}: {exc}"[:TEXT_CHARACTERS]
                self.say(Defect(reason=reason, text=traceback.format_exc()[-TEXT_CHARACTERS:]))
        finally:
            self._asked = False

    def _work(self, work: Question) -> None:
        bundles = {digest: Path(folder) for digest, folder in work.bundles.items()}
        if not isinstance(work, LanesWork | PicturesWork):
            self._pipeline = None  # with all chunks that were begun early
        match work:
            case LanesWork():
                self._lanes(work, bundles)
            case AuditWork():
                self._audit(work, bundles)
            case ReplayWork():
                self._again(work, bundles)
            case PicturesWork():
                self._pictures(work, bundles)

    def _keep(self, worlds: SentWorlds) -> None:
        for name in worlds.gone:
            self._worlds.pop(name, None)
        self._worlds |= {name: World.model_validate_json(text) for name, text in worlds.new.items()}

    def _lanes(self, work: LanesWork, bundles: Mapping[str, Path]) -> None:
        from tasks.simulate.chunk.chunk_pipeline import ChunkPipeline  # noqa: PLC0415
        from tasks.simulate.chunk.chunk_simulation import simulate_episodes  # noqa: PLC0415

        known = {**self._chunks, **{chunk.number: chunk for chunk in work.new}}
        self._chunks = {number: known[number] for number in work.numbers}
        chunk, *ahead = self._chunks.values()
        if self._pipeline is None and (ahead or _NARROW * len(chunk.requests) > work.lanes):
            self._pipeline = ChunkPipeline()
        recorder = None if work.rate_hz is None else _Forward(self.say, work.rate_hz, work.recorded)
        with collect_timings() as timings, collect_tags() as tags:
            rows = simulate_episodes(
                chunk,
                self._worlds,
                bundles,
                lanes=work.lanes,
                engine=work.engine,
                should_stop=self._should_stop,
                progress=self._progress,
                recorder=recorder,
                pipeline=self._pipeline,
                ahead=ahead,
            )
        rest = rows.take(np.flatnonzero(~np.isin(rows.index, recorder.told if recorder else [])))
        self.say(Rows(timings=tuple(timings), tags=tags), [_row_bytes(rest)])

    def _audit(self, work: AuditWork, bundles: Mapping[str, Path]) -> None:
        from tasks.simulate.audit.audit_drive import drive_audit, drive_control  # noqa: PLC0415
        from tasks.simulate.audit.audit_report import drive_arrays  # noqa: PLC0415

        with collect_timings() as timings:
            if work.control:
                drives, why = drive_control(work.others, self._worlds, bundles, lanes=work.lanes), ""
            else:
                *drives, why = drive_audit(
                    work.here,
                    work.others,
                    self._worlds,
                    bundles,
                    lanes=work.lanes,
                    engine=work.engine,
                    progress=self._progress,
                )
        arrays = [array for each in drives for array in drive_arrays(each)]
        self.say(Audited(why=why, timings=tuple(timings)), arrays)

    def _again(self, work: ReplayWork, bundles: Mapping[str, Path]) -> None:
        from tasks.simulate.replay.replay_drive import drive_replay  # noqa: PLC0415
        from tasks.simulate.replay.replay_result import replay_message  # noqa: PLC0415

        replay = drive_replay(
            work.request,
            self._worlds,
            bundles,
            lanes=work.lanes,
            engine=work.engine,
            rate_hz=work.rate_hz,
            beside=work.beside,
        )
        self.say(*replay_message(replay))

    def _pictures(self, work: PicturesWork, bundles: Mapping[str, Path]) -> None:
        from tasks.simulate.replay.picture_drive import pictures_again  # noqa: PLC0415

        self.say(*pictures_again(work, self._worlds, bundles))

    def _progress(self, done: int) -> None:
        self.say(Progress(done=done))

    def _should_stop(self) -> bool:
        while not self._stopped and self._poll.poll(0):
            self._stopped = "stop" in receive(self._connection, QUESTION).document
        return self._stopped


class _Forward:
    """Tells a recorder in another process what lanes do.

    Attributes:
        told: Indices of the rows that it was told.
    """

    def __init__(self, say: _Say, rate_hz: float, choice: RecordingChoice | None) -> None:
        self._say, self.rate_hz, self._choice = say, rate_hz, choice
        self._lanes, self._stride, self._before = 0, 1, 0
        self.told: list[int] = []

    def wants(self, rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        return np.ones(len(rows), np.bool_) if self._choice is None else self._choice.chosen(rows)

    def begin(self, lanes: int, control_s: float) -> None:
        self._lanes, self._stride, self._before = lanes, sample_stride(self.rate_hz, control_s), 0
        self._say(RecordingBegins(lanes=lanes, control_s=control_s), ())

    def keep(self, slice_: Steps, steps: Int[np.ndarray, "lanes"]) -> None:
        samples = slice_samples(slice_, steps, lanes=self._lanes, before=self._before, stride=self._stride)
        self._before += samples.steps
        self.add(samples, steps)

    def add(self, samples: SliceSamples, steps: Int[np.ndarray, "lanes"]) -> None:
        self._say(Samples(steps=samples.steps), (*samples[1:], np.asarray(steps)))

    def end(self, ends: Ends, rows: Sequence[EpisodeResult] | EpisodeColumns) -> None:
        columns = EpisodeColumns.of(rows)
        self._say(RecordingEnds(), (_row_bytes(columns), *ends))
        self.told += columns.index.tolist()


def _row_bytes(rows: EpisodeColumns) -> np.ndarray:
    return np.frombuffer(encode_columns(rows), np.uint8)


def _end_with_parent(connection: socket.socket) -> None:
    """Ends this process when whoever asks is gone, whatever its main thread is doing."""
    poll = select.poll()
    poll.register(connection, select.POLLHUP)
    poll.poll()
    os._exit(1)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's interrupt is for whoever asks
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    asking = socket.socket(fileno=int(sys.argv[1]))
    threading.Thread(target=_end_with_parent, args=(asking,), name="simyard end", daemon=True).start()
    main(asking, int(sys.argv[2]))
