"""Runs a chunk that does not fit into memory in parts, half as large each time, until they fit.

A lane's result does not depend on how many lanes run beside it (docs/decisions/0004), so neither the chunk's rows nor
what is committed changes.
"""

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult, Failure, failed_result, unfinished_result
from tasks.simulate.host.host_lanes import FEWEST_LANES
from tasks.simulate.plan.chunks import Chunk

logger = logging.getLogger(__name__)
SimulatePart = Callable[[Chunk, int], list[EpisodeResult]]


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

    rows: list[EpisodeResult]
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
    rows: list[EpisodeResult] = []
    while len(rows) < len(chunk.requests):
        part = chunk.requests[len(rows) : len(rows) + lanes]
        if rows and stopped():
            rows += [
                unfinished_result(request.index, "Canceled", failure_code="", failure_reason="") for request in part
            ]
            continue
        done = _tried(chunk.model_copy(update={"requests": part}), lanes, simulate)
        if not isinstance(done, _Lack):
            rows += done
        elif lanes > FEWEST_LANES:
            lanes = max(FEWEST_LANES, done.most or lanes // 2)
            logger.warning("chunk %d: going on with %d lanes at a time: %s", chunk.number, lanes, done.why)
        else:
            rows += _lacking(part, done.why)
    return Fitted(rows, lanes)


def after_deaths(lanes: int, attempts: int) -> int:
    """Returns how many lanes to begin a chunk with whose process died so often: the kernel may have ended it.

    The first death is taken for an accident.
    """
    return max(min(lanes, FEWEST_LANES), lanes >> max(0, attempts - 2))


def _tried(chunk: Chunk, lanes: int, simulate: SimulatePart) -> "list[EpisodeResult] | _Lack":
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
