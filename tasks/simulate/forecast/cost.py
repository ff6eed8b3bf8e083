"""The cost model: predicts how long chunks take and how much memory they need.

A simple model of each engine, measured once, says how costs grow with lanes and steps; what this machine took before
(``timings``) says how fast it is and what the applications cost, which no model knows. Without such memory a short
probe compares this machine with the one of the measurements, and the range is wide.
"""

import math
import time
from collections.abc import Sequence
from statistics import median

from pydantic import Field

from specs.base import Spec
from specs.data.engine_name import EngineName
from specs.data.episode import CONTROL_HZ
from tasks.simulate.chunk.timings import ChunkTiming
from tasks.simulate.engine.engines import ENGINES, EngineCost
from tasks.simulate.plan.chunks import SLICE_STEPS

_PROBE_S = 0.00087
_MEASURED_DEVICES = 2


class Span(Spec):
    """From this to that."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Returns what is as many times the least as the most is times it."""
        return math.sqrt(max(self.low, 0.0) * self.high)

    def plus(self, other: "Span") -> "Span":
        """Returns the sum of what both may be."""
        return Span(low=self.low + other.low, high=self.high + other.high)

    def times(self, factor: float) -> "Span":
        """Returns so many of it."""
        return Span(low=factor * self.low, high=factor * self.high)


class Speed(Spec):
    """How much longer this machine takes than the model says.

    Attributes:
        drive: For control steps.
        ready: To make episodes ready.
        first: Seconds to compile or load a program; None if that is not known.
        share: Which part of their longest duration chunks take until their last episode ends.
        peak_bytes: The most memory that was seen for each lane count; empty if nothing is known.
    """

    drive: Span
    ready: Span
    share: Span
    first: Span | None = None
    peak_bytes: dict[int, int] = Field(default_factory=dict[int, int])


def remembered_speed(timings: Sequence[ChunkTiming], lanes: int, *, same_program: bool) -> Speed | None:
    """Returns what timings of an engine say; None if there are none of driving.

    Args:
        timings: Of one engine and kind of device.
        lanes: Of the chunks that are asked about: chunks of very different sizes are left out if there are others.
        same_program: Whether they are of the very applications that are asked about.
    """
    driven = [each for each in timings if each.slices > 0]
    known = [each for each in driven if lanes <= 2 * each.lanes <= 4 * lanes] or driven
    if not known:
        return None
    drive = [each.slices_s / (each.slices * _slice_s(ENGINES[each.engine].cost, each.lanes)) for each in known]
    ready = [each.ready_s / (each.episodes * ENGINES[each.engine].cost.ready_s) for each in known]
    shares = [each.slices / max(1, each.most_slices) for each in known]
    return Speed(
        drive=_spread(drive, 1.25 if same_program else 2.0),
        ready=_spread(ready, 1.25 if same_program else 2.0),
        share=Span(low=min(shares), high=max(shares)) if same_program else Span(low=0.5, high=1.0),
        first=_first(known) if same_program else None,
        peak_bytes={each.lanes: each.peak_bytes for each in known} if same_program else {},
    )


def probed_speed(devices: int) -> Speed:
    """Returns a guess from a hundredth of a second of arithmetic; the applications may be anything."""
    slower = _probe_s() / _PROBE_S * _MEASURED_DEVICES / max(1, devices)
    return Speed(
        drive=Span(low=0.5 * slower, high=2.0 * slower),
        ready=Span(low=0.5 * slower, high=2.0 * slower),
        share=Span(low=0.5, high=1.0),
    )


def driving_s(engine: EngineName, speed: Speed, *, episodes: int, lanes: int, chunks: int, duration_s: float) -> Span:
    """Returns the wall seconds of a program's chunks, compiling apart.

    Args:
        engine: What drives.
        speed: This machine's.
        episodes: In all.
        lanes: Of a chunk.
        chunks: How many there are.
        duration_s: The longest simulated time of an episode.
    """
    cost = ENGINES[engine].cost
    slices = -(-max(1, round(duration_s * CONTROL_HZ)) // SLICE_STEPS)
    each_s = slices * _slice_s(cost, lanes)
    drive = Span(low=speed.drive.low * speed.share.low, high=speed.drive.high * speed.share.high).times(each_s * chunks)
    return drive.plus(speed.ready.times(cost.ready_s * episodes))


def compiling_s(engine: EngineName, speed: Speed) -> Span:
    """Returns the wall seconds until a program's first step; one that never ran here is not in the cache."""
    if speed.first is not None:
        return speed.first
    cost = ENGINES[engine].cost
    ready = max(0.5, min(2.0, median([speed.ready.low, speed.ready.high])))
    return Span(low=0.6 * cost.compile_s * ready, high=1.6 * cost.compile_s * ready)


def memory_bytes(engine: EngineName, speed: Speed, lanes: int) -> Span:
    """Returns the most memory that a process takes which drives so many lanes at a time."""
    cost = ENGINES[engine].cost
    if speed.peak_bytes:
        nearest = min(speed.peak_bytes, key=lambda known: abs(known - lanes))
        seen = speed.peak_bytes[nearest] + (lanes - nearest) * cost.lane_bytes
        return Span(low=0.7 * seen, high=1.3 * seen)
    grown = cost.base_bytes + lanes * cost.lane_bytes
    return Span(low=0.6 * grown, high=cost.base_bytes * 1.3 + 3.0 * lanes * cost.lane_bytes)


def _first(timings: Sequence[ChunkTiming]) -> Span:
    """Returns what a program may take to compile or load: within a process, only the first chunk has to."""
    most_s = max(each.compile_s for each in timings)
    return Span(low=min(0.5 * most_s, ENGINES[timings[0].engine].cost.load_s), high=1.25 * most_s)


def _slice_s(cost: EngineCost, lanes: int) -> float:
    return SLICE_STEPS * (cost.step_s + lanes * cost.lane_step_s)


def _spread(ratios: Sequence[float], margin: float) -> Span:
    return Span(low=min(ratios) / margin, high=max(ratios) * margin)


def _probe_s() -> float:
    """Returns the seconds of some arithmetic like that of a step: small arrays, many operations; the best of three."""
    import numpy as np  # noqa: PLC0415 - where this machine is known, planning does without

    values = np.linspace(0.0, 1.0, 4096, dtype=np.float32)

    def once() -> float:
        start_s = time.perf_counter()
        for _ in range(200):
            np.sqrt(values * values + 1.0).sum()
        return time.perf_counter() - start_s

    return min(once() for _ in range(3))
