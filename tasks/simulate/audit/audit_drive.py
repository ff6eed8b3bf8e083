"""The parity audit: drives a sample of a batch's episodes again, on their engine and on C MuJoCo, and compares.

C MuJoCo steps them in double precision among all solids. The engine that made the rows drives the sample again too:
that gives the ways to compare, and shows whether the rows are what it makes of their requests. Rows that C MuJoCo made
are made again and compared with nothing: that an engine agrees with itself says only that the rows are its own.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float32

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.code import BundleCrash
from tasks.simulate.audit.audit_report import AuditFlipRate, AuditReport, Flip, apart_quantiles, with_verdict
from tasks.simulate.audit.audit_sample import SampledEpisode, row_failed
from tasks.simulate.chunk.episodes import ReadyChunk, keep_timing, ready_parts
from tasks.simulate.chunk.run_rows import lane_row, open_run
from tasks.simulate.devices import device_kind
from tasks.simulate.engine.engines import REFERENCE
from tasks.simulate.host.host_lanes import most_lanes
from tasks.simulate.plan.chunks import plan_chunks


class DrivenEpisode(NamedTuple):
    """An episode driven again: its row, and its place at the end of each control step."""

    engine: str
    row: EpisodeResult
    places_m: Float32[np.ndarray, "steps 2"]


def drive_sample(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
) -> dict[int, DrivenEpisode]:
    """Returns episodes driven to their ends, by index; without those that could not start.

    Args:
        requests: Any of a batch.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: Of a program.
        engine: ``auto``, or the engine that must drive them.

    Raises:
        BundleCrash: An application does not import, or raises when it is traced.
    """
    lanes = min(lanes, most_lanes(requests, bundles) or lanes)
    return {
        each.row.index: each
        for chunk in plan_chunks(requests, lanes)
        for each in _driven_chunk(chunk.requests, worlds, bundles, lanes=lanes, engine=engine)
    }


def _driven_chunk(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
) -> list[DrivenEpisode]:
    parts = ready_parts(requests, worlds, bundles, lanes=lanes, engine=engine)
    return [each for part in parts for each in _driven_part(part)]


def _driven_part(chunk: ReadyChunk) -> list[DrivenEpisode]:
    if chunk.run is None:
        return []
    poses: list[Float32[np.ndarray, "lanes steps 3"]] = []
    with open_run(chunk.run) as run:
        state = run.begin()
        while not np.all(state.done):
            state, record = run.advance(state)
            poses.append(np.asarray(record.pose))
            chunk.watch.mark()
    keep_timing(chunk)
    end, path = jax.device_get(state._replace(controller=None, scenario=None)), np.concatenate(poses, axis=1)
    return [
        DrivenEpisode(
            engine=chunk.program.engine,
            row=lane_row(chunk.program, chunk.run, lane, position, end, poses),
            places_m=path[position, : int(end.step[position]), :2],
        )
        for position, lane in enumerate(chunk.lanes)
    ]


# What a row holds besides what the simulation gave it; how lock-step held is judged by itself.
_BESIDES = {"recording", "failure_reason", "late", "stray"}
# All that is promised of a GPU, where the order of additions is not fixed.
_ENDS = {"status", "failure_code", "outcome", "outcome_reason"}


def audit(
    sample: Sequence[SampledEpisode],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    drawn: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> AuditReport:
    """Returns what driving a sample again shows.

    Args:
        sample: At least one episode.
        worlds: At least those of the sample.
        bundles: Unpacked folders of the applications, by digest.
        lanes: Lanes of a program: no more than there are episodes, since a program's idle lanes cost as much.
        engine: What the batch asked for.
        drawn: How many episodes were to be audited, if more than the sample: worlds may be gone.
        progress: Told how many of two drives for each episode are done, or will not be made.

    Raises:
        BundleCrash: An application that made rows before now fails.
    """
    here = [each for each in sample if each.row.device == device_kind()]
    ours = drive_sample([each.request for each in here], worlds, bundles, lanes=lanes, engine=engine)
    progress(len(here))
    others = [each.request for each in sample if each.row.engine != REFERENCE]
    theirs: dict[int, DrivenEpisode] = {}
    why = f"the rows were made by {REFERENCE}, the reference itself"
    if others:
        try:
            theirs = drive_sample(others, worlds, bundles, lanes=lanes, engine=REFERENCE)
        except BundleCrash as crash:
            why = crash.reason
    progress(2 * len(sample))
    return with_verdict(_report(sample, ours, theirs, max(drawn, len(sample))), why)


def _report(
    sample: Sequence[SampledEpisode], ours: Mapping[int, DrivenEpisode], theirs: Mapping[int, DrivenEpisode], drawn: int
) -> AuditReport:
    both = [each for each in sample if each.row.index in theirs]
    flipped = {each.row.index for each in both if _end(each.row) != _end(theirs[each.row.index].row)}
    here = [each.row for each in sample if each.row.device == device_kind()]
    ways_m = {
        each.row.index: _most_apart_m(ours[each.row.index], theirs[each.row.index])
        for each in both
        if each.row.index in ours
    }
    return AuditReport(
        verdict="NOT RUN",
        sentence="",
        engine=", ".join(sorted({each.row.engine for each in sample if each.row.engine})),
        reference=REFERENCE,
        sampled=drawn,
        lanes=len(sample),
        compared=len(both),
        final=apart_quantiles([_apart_m(each.row, theirs[each.row.index].row) for each in both]),
        way=apart_quantiles([*ways_m.values()]),
        unflipped=apart_quantiles([apart_m for index, apart_m in ways_m.items() if index not in flipped]),
        spread=_rate([each.row.index for each in both if each.spread], flipped),
        failed=_rate([each.row.index for each in both if row_failed(each.row)], flipped),
        flips=tuple(
            Flip(index=row.index, row=_end(row), reference=_end(theirs[row.index].row))
            for row in (each.row for each in both)
            if row.index in flipped
        ),
        unreproduced=tuple(row.index for row in here if not _reproduced(row, ours)),
        ros=sum(each.row.late is not None for each in sample),
        unlocked=tuple(each.row.index for each in sample if _unlocked(each.row, ours.get(each.row.index))),
        elsewhere=tuple(each.row.index for each in sample if each.row.device != device_kind()),
    )


def _unlocked(row: EpisodeResult, again: DrivenEpisode | None) -> bool:
    """Returns whether lock-step did not hold in an episode, when its row was made or when it was driven again."""
    rows = [row, again.row] if again else [row]
    return any(each.late or each.stray for each in rows)


def _rate(indices: Sequence[int], flipped: set[int]) -> AuditFlipRate:
    return AuditFlipRate(lanes=len(indices), flips=len(flipped.intersection(indices)))


def _end(row: EpisodeResult) -> str:
    return row.outcome_reason or row.outcome


def _apart_m(row: EpisodeResult, other: EpisodeResult) -> float:
    return float(np.hypot(row.final_x_m - other.final_x_m, row.final_y_m - other.final_y_m))


def _most_apart_m(ours: DrivenEpisode, theirs: DrivenEpisode) -> float:
    steps = min(len(ours.places_m), len(theirs.places_m))
    return float(np.hypot(*(ours.places_m[:steps] - theirs.places_m[:steps]).T).max(initial=0.0))


def _reproduced(row: EpisodeResult, ours: Mapping[int, DrivenEpisode]) -> bool:
    if row.index not in ours:
        return False
    again = ours[row.index].row
    if device_kind() == "gpu":
        return row.model_dump(include=_ENDS) == again.model_dump(include=_ENDS)
    return row.model_dump(exclude=_BESIDES) == again.model_dump(exclude=_BESIDES)
