"""Runs a chunk that does not fit into memory in parts, half as large each time, until they fit.

A lane's result does not depend on how many lanes run beside it (docs/decisions/0004), so neither the chunk's rows nor
what is committed changes.
"""

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult, Failure, failed_result, unfinished_result
from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.host.host_lanes import FEWEST_LANES
from tasks.simulate.plan.chunks import Chunk

logger = logging.getLogger(__name__)
Results = Sequence[EpisodeResult] | EpisodeColumns
SimulatePart = Callable[[Chunk, int], Results]


class TooManyLanes(MemoryError):  # noqa: N818 - a state
    """So many lanes would not fit, which is known before they are tried.

    Attributes:
        most: How many do.
    """

    def __init__(self, why: str, most: int) -> None:
        self.most = most
        super().__init__(why)


class _Lack(NamedTuple):
    """Why lanes did not fit, and how many do where that is known; 0 where it is not."""

    why: str
    most: int = 0


class Fitted(NamedTuple):
    """A chunk's rows in request order, and how many lanes fitted."""

    rows: EpisodeColumns
    lanes: int


def simulate_fitting(chunk: Chunk, lanes: int, simulate: SimulatePart, stopped: Callable[[], bool]) -> Fitted:
    """Returns a chunk's rows, simulated with as many lanes at a time as the memory holds.

    Args:
        chunk: The chunk.
        lanes: Most lanes to try.
        simulate: Runs a part of the chunk with so many lanes.
        stopped: Whether the rest shall not be begun.

    Raises:
        Exception: Whatever else than a lack of memory goes wrong.
    """
    parts: list[EpisodeColumns] = []
    while (done := sum(map(len, parts))) < len(chunk.requests):
        part = chunk.requests[done : done + lanes]
        if parts and stopped():
            parts.append(EpisodeColumns.of(_left(part)))
            continue
        found = _tried(chunk.model_copy(update={"requests": part}), lanes, simulate)
        if not isinstance(found, _Lack):
            parts.append(EpisodeColumns.of(found))
        elif lanes > FEWEST_LANES:
            lanes = max(FEWEST_LANES, found.most or lanes // 2)
            logger.warning("chunk %d: going on with %d lanes at a time: %s", chunk.number, lanes, found.why)
        else:
            parts.append(EpisodeColumns.of(_lacking(part, found.why)))
    return Fitted(EpisodeColumns.join(parts), lanes)


def after_deaths(lanes: int, attempts: int) -> int:
    """Returns how many lanes to begin a chunk with whose process died so often: the kernel may have ended it.

    The first death is taken for an accident.
    """
    return max(min(lanes, FEWEST_LANES), lanes >> max(0, attempts - 2))


def _left(requests: Sequence[EpisodeRequest]) -> list[EpisodeResult]:
    return [unfinished_result(request.index, "Canceled", failure_code="", failure_reason="") for request in requests]


def _tried(chunk: Chunk, lanes: int, simulate: SimulatePart) -> Results | _Lack:
    """Returns rows, or what the lack of memory was called; what it held is free again then."""
    try:
        return simulate(chunk, lanes)
    except TooManyLanes as exc:
        return _Lack(str(exc), exc.most)
    except MemoryError as exc:
        return _Lack(f"out of memory: {exc}")
    except RuntimeError as exc:
        if "RESOURCE_EXHAUSTED" not in str(exc):  # XLA's status for an allocation that failed
            raise
        return _Lack(f"out of memory: {exc}")


def _lacking(requests: Sequence[EpisodeRequest], lack: str) -> list[EpisodeResult]:
    why = " ".join(lack.removeprefix("out of memory: ").split())[:500]
    reason = f"out of memory even with {FEWEST_LANES} lanes: {why}"
    return [failed_result(request.index, Failure("InternalServiceError", reason)) for request in requests]
