"""Parity audit: a sample of a batch's lanes, driven again on C MuJoCo in double precision among all solids.

The engine that made the rows drives the sample again too. That gives the ways to compare, and shows whether the rows
are what it makes of their requests. This module imports no JAX itself, as ``tasks.simulate.runner``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from specs.base import Spec
from specs.episode import EpisodeRequest, EpisodeResult
from specs.world import World
from tasks.simulate.devices import prepare_devices

if TYPE_CHECKING:
    from tasks.simulate.audit_driving import Driven

AUDITED_LANES = 16
_REFERENCE = "mujoco"
# What a row holds besides what the simulation gave it.
_BESIDES = {"recording", "failure_reason"}


class Deviation(Spec):
    """How far apart the robots of two engines were, over the lanes of a sample (m)."""

    median_m: float
    p90_m: float
    max_m: float


class Flip(Spec):
    """An episode that came to another end on C MuJoCo: ``Passed``, or why it failed."""

    index: int
    row: str
    reference: str


class AuditReport(Spec):
    """What an audit found.

    Attributes:
        engine: Which made the rows.
        reference: What it is compared with.
        lanes: Episodes that were driven again.
        final: Between the places where episodes ended.
        way: The most at any control step that both had.
        flips: Episodes with another outcome.
        flip_rate: Their share, 0-1.
        unreproduced: Episodes whose row is not what the engine makes of their request.
    """

    engine: str
    reference: str
    lanes: int
    final: Deviation
    way: Deviation
    flips: tuple[Flip, ...]
    flip_rate: float
    unreproduced: tuple[int, ...]


def audited_positions(episodes: int, lanes: int = AUDITED_LANES) -> list[int]:
    """Returns which of so many episodes are audited: evenly spread, from the first to the last."""
    return sorted({int(position) for position in np.linspace(0, episodes - 1, min(lanes, episodes)).round()})


def audit(
    requests: Sequence[EpisodeRequest],
    rows: Sequence[EpisodeResult],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int = AUDITED_LANES,
    engine: str = "auto",
    chunk_lanes: int | None = None,
) -> AuditReport | None:
    """Returns what driving a sample of a batch again shows; None when no episode of it was driven to an end.

    Args:
        requests: Of the batch, or of its episodes at ``audited_positions``.
        rows: Of the requests, in their order.
        worlds: At least those of the sample.
        bundles: Unpacked folders of the applications, by digest.
        lanes: Most episodes to drive again.
        engine: What the batch asked for.
        chunk_lanes: Lanes of the batch's chunks, whose compiled program serves again; else as many as are audited.

    Raises:
        BundleCrash: An application that made rows before now fails.
        JaxAlreadyImported: JAX was imported before its settings could be made.
    """
    ended = [(request, row) for request, row in zip(requests, rows, strict=True) if _was_driven(row)]
    sample = [ended[position] for position in audited_positions(len(ended), lanes)]
    if not sample:
        return None
    asked = [request for request, _ in sample]
    prepare_devices()
    from tasks.simulate.audit_driving import driven  # noqa: PLC0415 - JAX reads its settings when it is imported

    ours = driven(asked, worlds, bundles, lanes=chunk_lanes or lanes, engine=engine)
    theirs = driven(asked, worlds, bundles, lanes=lanes, engine=_REFERENCE)
    return _report([row for _, row in sample], ours, theirs)


def _was_driven(row: EpisodeResult) -> bool:
    return row.status != "Canceled" and row.simulated_s > 0.0


def _report(rows: Sequence[EpisodeResult], ours: "Mapping[int, Driven]", theirs: "Mapping[int, Driven]") -> AuditReport:
    both = [row for row in rows if row.index in ours and row.index in theirs]
    flips = [
        Flip(index=row.index, row=_end(row), reference=_end(theirs[row.index].row))
        for row in both
        if _end(row) != _end(theirs[row.index].row)
    ]
    return AuditReport(
        engine=", ".join(sorted({each.engine for each in ours.values()})),
        reference=_REFERENCE,
        lanes=len(both),
        final=_deviation([_apart_m(row, theirs[row.index].row) for row in both]),
        way=_deviation([_most_apart_m(ours[row.index], theirs[row.index]) for row in both]),
        flips=tuple(flips),
        flip_rate=len(flips) / len(both) if both else 0.0,
        unreproduced=tuple(row.index for row in rows if not _reproduced(row, ours)),
    )


def _end(row: EpisodeResult) -> str:
    return row.outcome_reason or row.outcome


def _apart_m(row: EpisodeResult, other: EpisodeResult) -> float:
    return float(np.hypot(row.final_x_m - other.final_x_m, row.final_y_m - other.final_y_m))


def _most_apart_m(ours: "Driven", theirs: "Driven") -> float:
    steps = min(len(ours.places_m), len(theirs.places_m))
    return float(np.hypot(*(ours.places_m[:steps] - theirs.places_m[:steps]).T).max(initial=0.0))


def _reproduced(row: EpisodeResult, ours: "Mapping[int, Driven]") -> bool:
    return row.index in ours and row.model_dump(exclude=_BESIDES) == ours[row.index].row.model_dump(exclude=_BESIDES)


def _deviation(apart_m: Sequence[float]) -> Deviation:
    if not apart_m:
        return Deviation(median_m=0.0, p90_m=0.0, max_m=0.0)
    median, p90, most = np.quantile(apart_m, [0.5, 0.9, 1.0])
    return Deviation(median_m=float(median), p90_m=float(p90), max_m=float(most))
