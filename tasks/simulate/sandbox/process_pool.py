"""The processes that simulate for this one: each serves one set of applications, and is kept for a while."""

import atexit
import logging
import os
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path

from specs.errors import BundleRefused
from tasks.simulate.sandbox.process_environment import passed_variable
from tasks.simulate.sandbox.protocol import Question
from tasks.simulate.sandbox.simulator import OnAnswer, Simulator, SimulatorEnded, Told
from tasks.storage.sealed_bundle import FILES_FOLDER, changed_bundle

logger = logging.getLogger(__name__)
# A batch asks again within seconds, or once the chunk of its other robot is done; between batches its memory is of
# more use to others.
_IDLE_S = 60.0
# One that was begun before its batch is asked when the worlds are made.
_PREPARED_S = 180.0
_IDLE_AT_MOST = 2
_Wanted = Callable[[int, float], bool]
_Key = tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]


class _Idle:
    """Processes that nobody asks now, the one used last at the end."""

    def __init__(self) -> None:
        self._lock, self._owner = threading.Lock(), os.getpid()
        self._kept: list[tuple[_Key, Simulator, float]] = []  # until when it is kept, if nobody asks
        self._timer: threading.Timer | None = None  # the one that ends those whose time is over

    def take(self, key: _Key) -> Simulator | None:
        with self._lock:
            if self._owner != os.getpid():  # another process's children, after a fork
                self._owner, self._kept, self._timer = os.getpid(), [], None
            for entry in reversed(self._kept):
                if entry[0] == key and entry[1].alive:
                    self._kept.remove(entry)
                    self._wait_for_next()
                    return entry[1]
        return None

    def keep(self, key: _Key, simulator: Simulator, idle_s: float = _IDLE_S) -> None:
        with self._lock:
            self._kept.append((key, simulator, time.monotonic() + idle_s))
        self._end(lambda place, _: place < len(self._kept) - _IDLE_AT_MOST)

    def end_unused(self) -> None:
        now_s = time.monotonic()
        self._end(lambda _, until_s: now_s >= until_s)

    def end_all(self) -> None:
        self._end(lambda _place, _until_s: True)

    def _end(self, wanted: _Wanted) -> None:
        with self._lock:
            ended = [entry for place, entry in enumerate(self._kept) if wanted(place, entry[2])]
            self._kept = [entry for entry in self._kept if entry not in ended]
            self._wait_for_next()
        for _, simulator, _ in ended:
            simulator.end()

    def _wait_for_next(self) -> None:
        """Lets one thread wait for the process whose time is over first; none where none is kept."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._kept:
            left_s = max(0.0, min(until_s for _, _, until_s in self._kept) - time.monotonic())
            self._timer = threading.Timer(left_s + 1.0, self.end_unused)
            self._timer.daemon = True
            self._timer.start()


_idle = _Idle()
atexit.register(_idle.end_all)


@contextmanager
def simulator(bundles: Mapping[str, Path]) -> Generator[Simulator, None, None]:
    """Yields a process that simulates with these applications, for this thread alone.

    The bundles are compared with their digests each time, whether a process is there or a new one begins: what it reads
    of files that were changed meanwhile must not pass for theirs.

    Args:
        bundles: Unpacked folders of the applications, by digest.

    Raises:
        BundleRefused: A folder has been changed since it was unpacked.
    """
    _require_unchanged(bundles)
    key = _key(bundles)
    found = _idle.take(key) or Simulator(bundles)
    try:
        yield found
    finally:
        if found.alive:
            _idle.keep(key, found)
        else:
            found.end()


def ask_exclusive(
    bundles: Mapping[str, Path],
    question: Callable[[Simulator], Question],
    on_answer: OnAnswer = lambda _answer, _arrays: None,
) -> Told:
    """Returns the last answer to a question that is about no chunk, and its arrays.

    A process that ends over it may have worked on chunks ahead, which are to blame then: another one is asked once.

    Args:
        bundles: Unpacked folders of the applications, by digest.
        question: Makes the question for a process, which has some worlds already.
        on_answer: Given each answer before the last, of both processes.

    Raises:
        BundleRefused: A folder has been changed since it was unpacked.
        SimulatorEnded: The process ended over the question.
    """
    try:
        return _ask_one(bundles, question, on_answer)
    except SimulatorEnded as ended:
        if not ended.beside_others:
            raise
        logger.warning("%s; once more, without the chunks that it began early", ended.reason)
    return _ask_one(bundles, question, on_answer)


def _ask_one(
    bundles: Mapping[str, Path],
    question: Callable[[Simulator], Question],
    on_answer: OnAnswer,
) -> Told:
    with simulator(bundles) as process:
        return process.ask(question(process), on_answer=on_answer)


def prepare_simulator(bundles: Mapping[str, Path]) -> None:
    """Begins a process that simulates with these applications, for who asks for it within minutes; returns at once.

    Nothing of theirs is imported or run before that. It costs a second or two of the processor, most of it for JAX.

    Args:
        bundles: Unpacked folders of the applications, by digest.
    """
    key = _key(bundles)
    _idle.keep(key, _idle.take(key) or Simulator(bundles), _PREPARED_S)


def _key(bundles: Mapping[str, Path]) -> _Key:
    """Returns what a process has to have in common with who asks for it: its bundles, and how it simulates."""
    settings = sorted(
        (name, value) for name, value in os.environ.items() if name.startswith("SIMYARD_") or passed_variable(name)
    )
    return tuple(sorted((digest, str(folder)) for digest, folder in bundles.items())), tuple(settings)


def _require_unchanged(bundles: Mapping[str, Path]) -> None:
    """Lets bundles pass that are what their digests say; one that is no sealed one is a test's own.

    Raises:
        BundleRefused: A folder has been changed since it was unpacked.
    """
    for digest, folder in bundles.items():
        if folder.name == FILES_FOLDER and changed_bundle(folder):
            raise BundleRefused(f"{folder} is not the bundle {digest} any more; run it again, and it is unpacked anew")
