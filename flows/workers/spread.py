"""Spreads pieces of work over workers, and hands out again what was lost.

The store says which pieces are done, not the future of a task: a worker that dies after it has committed has done its
work.
"""

import asyncio
import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from prefect.futures import PrefectFuture

from specs.errors import StageFailed

_LOG = logging.getLogger(__name__)
# A worker that ends a task finds the next one there; more than that is not handed out ahead.
_AHEAD = 2
_ATTEMPTS = 4
# Long beside what handing out a piece costs its worker. Who works on one looks at the record before each chunk, so that
# a cancellation does not wait for its end, and has committed what was done of it when it dies.
_AIM_S = 15.0
# Handing out a piece costs this process, and Prefect's server, about a tenth of a second each
# (docs/operate/scale.md): many workers get longer ones, so that both keep up with any number of them.
_AIM_S_A_WORKER = 0.2
_LOOK_S = 0.5
# Workers that live end a piece that nobody wants within seconds; a cluster may have lost them all.
_PATIENCE_S = 20.0

Numbers = tuple[int, ...]


class PieceOutcome(NamedTuple):
    """A piece that was handed out, and what became of it.

    Attributes:
        result: What its task returned; None if it did not come to that.
        failure: Why it did not.
    """

    numbers: Numbers
    result: Any
    failure: str


class PieceSize:
    """How many numbers go into a piece, by how long the last ones took."""

    def __init__(self) -> None:
        self._each_s: float | None = None

    def learn(self, numbers: int, wall_s: float) -> None:
        """Learns how long a worker took for a piece."""
        each_s = wall_s / max(numbers, 1)
        self._each_s = each_s if self._each_s is None else 0.5 * (self._each_s + each_s)

    def size(self, left: int, width: int) -> int:
        """Returns how many of what is left go into the next piece; so few of the last ones that all workers share."""
        if self._each_s is None:
            return 1
        aim_s = max(_AIM_S, width * _AIM_S_A_WORKER)
        return max(1, min(int(aim_s / max(self._each_s, 1e-3)), left // (width * _AHEAD)))


def spread(
    numbers: Sequence[int],
    hand_out: Callable[[Numbers], PrefectFuture[Any]],
    *,
    width: Callable[[], int],
    going: Callable[[], bool],
    missing: Callable[[Numbers], Numbers],
    on_end: Callable[[PieceOutcome], float],
) -> None:
    """Hands numbers out in order until all are done, or none is wanted any more.

    It waits for the workers; once nothing is wanted, for 20 seconds at most.

    Args:
        numbers: What there is to do.
        hand_out: Gives a piece to a worker.
        width: How many workers there are now.
        going: Whether anything more is wanted.
        missing: Which of some numbers are not done, whatever their workers said.
        on_end: Called with each piece that ended; returns how long its worker took, in seconds.

    Raises:
        StageFailed: A piece was lost four times.
    """
    pieces, unwanted = _Pieces(numbers, hand_out, width), _Unwanted(going)
    pace, lost = PieceSize(), Counter[int]()
    while pieces.left or pieces.flying:
        if unwanted():
            pieces.left.clear()
            if unwanted.for_long():
                _LOG.warning("%d pieces that nobody wants any more are not waited for", pieces.flying)
                return
        pieces.fill(pace)
        end = pieces.next_end()
        if end is None:
            continue
        if end.failure:
            pieces.left.extendleft(reversed(_to_repeat(end, missing(end.numbers), lost)))
        else:
            pace.learn(len(end.numbers), on_end(end))


class _Pieces:
    """Numbers that are not handed out yet, and the pieces that workers have.

    Attributes:
        left: Numbers that are not handed out.
        flying: How many pieces are handed out and have not ended.
    """

    def __init__(
        self, numbers: Sequence[int], hand_out: Callable[[Numbers], PrefectFuture[Any]], width: Callable[[], int]
    ) -> None:
        self.left, self.flying = deque(numbers), 0
        self._hand_out, self._width = hand_out, width
        self._ended: SimpleQueue[PieceOutcome] = SimpleQueue()

    def fill(self, pace: PieceSize) -> None:
        """Hands out so many pieces that each worker has the next one there."""
        while self.left and self.flying < self._width() * _AHEAD:
            piece = tuple(self.left.popleft() for _ in range(pace.size(len(self.left), self._width())))
            _await(piece, self._hand_out(piece), self._ended)
            self.flying += 1

    def next_end(self) -> PieceOutcome | None:
        """Returns a piece that ended; None if none did in half a second."""
        try:
            end = self._ended.get(timeout=_LOOK_S)
        except Empty:
            return None
        self.flying -= 1
        return end


class _Unwanted:
    """Whether nothing more is wanted, and since when."""

    def __init__(self, going: Callable[[], bool]) -> None:
        self._going = going
        self._since_s: float | None = None

    def __call__(self) -> bool:
        if self._going():
            return False
        self._since_s = time.monotonic() if self._since_s is None else self._since_s
        return True

    def for_long(self) -> bool:
        return self._since_s is not None and time.monotonic() - self._since_s >= _PATIENCE_S


def _to_repeat(end: PieceOutcome, missing: Numbers, lost: Counter[int]) -> Numbers:
    """Returns what of a piece has to be handed out again."""
    lost.update(missing)
    if any(lost[number] >= _ATTEMPTS for number in missing):
        why = f"{missing[0]} was lost {_ATTEMPTS} times, the last time because: {end.failure}"
        raise StageFailed("InternalServiceError", why)
    if missing:
        _LOG.warning("handing out %s again: %s", missing, end.failure)
    return missing


def _await(numbers: Numbers, future: PrefectFuture[Any], ended: "SimpleQueue[PieceOutcome]") -> None:
    """Puts a piece into the queue when it has ended; a future's own callbacks differ between Dask and Ray."""

    def wait() -> None:
        try:
            ended.put(PieceOutcome(numbers, future.result(), ""))
        # Whatever a worker died of is reported, and the store is asked; CancelledError is no Exception in Python.
        except (Exception, asyncio.CancelledError) as exc:  # noqa: BLE001 - see above
            ended.put(PieceOutcome(numbers, None, f"{type(exc).__name__}: {exc}"))

    threading.Thread(target=wait, name=f"piece {numbers[0]}", daemon=True).start()
