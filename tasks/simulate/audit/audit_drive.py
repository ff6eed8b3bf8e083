"""The parity audit: drives a sample of a batch's episodes again, on their engine and on C MuJoCo, and compares.

C MuJoCo steps them in double precision among all solids. The engine that made the rows drives the sample again too:
that gives the ways to compare, and shows whether the rows are what it makes of their requests. Where they differ,
C MuJoCo drives the sample again from a micrometre beside: what it flips by itself is chaos, and no engine's error. Rows
that C MuJoCo made are made again and compared with nothing: that an engine agrees with itself says only that the rows
are its own.

Parts of the sample are driven at a time, on threads of their own. What runs an application's code stays on the thread
that asks: its import, its tracing in the first slice, and controllers on the host. The rest is compiled, and steps in
C: on a thread of its own it drives beside the next part, which is being loaded meanwhile. What a part does depends on
no other.
"""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from jaxtyping import Float32

from specs.data.episode import EpisodeRequest, EpisodeResult, success
from specs.data.parity_audit import AuditControl, AuditReport, Flip
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.audit.audit_report import (
    APART_LIMIT_M,
    CALM_M,
    CONFIDENCE,
    ComparedLane,
    Ending,
    apart_quantiles,
    flip_share,
    needs_control,
    own_rate,
    share_bounds,
    total_share,
    weight_of,
    with_verdict,
)
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.chunk.byproducts import note_timing
from tasks.simulate.chunk.chunk_simulation import LaneDrive, ReadyChunk, ready_parts
from tasks.simulate.chunk.lane_pool import lane_row, open_run
from tasks.simulate.devices import device_count, device_kind
from tasks.simulate.engines.engine_table import REFERENCE
from tasks.simulate.engines.program import Run
from tasks.simulate.host.declaration import most_lanes
from tasks.simulate.plan.chunks import plan_chunks

# What a row holds besides what the simulation gave it; how lock-step held is judged by itself.
_BESIDES = {"recording", "failure_reason", "late", "stray"}
# All that is promised of a GPU, where the order of additions is not fixed.
_ENDS = {"status", "failure_code", "outcome", "outcome_reason"}


class DrivenEpisode(NamedTuple):
    """An episode driven again: its row, and its place at the end of each control step."""

    engine: str
    row: EpisodeResult
    places_m: Float32[np.ndarray, "steps 2"]


Driven = Mapping[int, DrivenEpisode]
"""Episodes that were driven again, by index."""


def findings(
    sample: Sequence[SampledEpisode], ours: Driven, theirs: Driven, control: Sequence[Driven], drawn: int
) -> AuditReport:
    """Returns the report of an audit, which has no verdict yet.

    Args:
        sample: What was audited.
        ours: By the engines that made the rows; without what another kind of device drove.
        theirs: By C MuJoCo; without what it had driven in the first place.
        control: The same by C MuJoCo a micrometre beside, in each direction; none if there was no control.
        drawn: How many episodes were to be audited.
    """
    both = [each for each in sample if each.row.index in theirs]
    lanes = [_compared_lane(each, theirs, control) for each in both]
    flips, others = _flips(both, lanes, theirs)
    ended_otherwise = {flip.index for flip in (*flips, *others)}
    ways_m = {i: _most_apart_m(ours[i], theirs[i]) for i in (each.row.index for each in both) if i in ours}
    unflipped_m = {index: apart_m for index, apart_m in ways_m.items() if index not in ended_otherwise}
    false_passes, false_alarms = flip_share(lanes, _passed), flip_share(lanes, _did_not_pass)
    here = [each.row for each in sample if each.row.device == device_kind()]
    return AuditReport(
        verdict="NOT RUN",
        sentence="",
        sampled=drawn,
        engine=", ".join(sorted({each.row.engine for each in sample if each.row.engine})),
        reference=REFERENCE,
        lanes=len(sample),
        compared=len(both),
        false_passes=false_passes,
        false_alarms=false_alarms,
        missed_contacts=flip_share(lanes, _untouched),
        total=total_share([false_passes, false_alarms]),
        control=_control_found(lanes, theirs, control, unflipped_m),
        final=apart_quantiles([_ends_apart_m(each.row, theirs[each.row.index].row) for each in both]),
        way=apart_quantiles([*ways_m.values()]),
        unflipped=apart_quantiles([*unflipped_m.values()]),
        flips=flips,
        others=others,
        unreproduced=tuple(row.index for row in here if not _reproduced(row, ours)),
        ros=sum(each.row.late is not None for each in sample),
        unlocked=tuple(each.row.index for each in sample if _unlocked(each.row, ours.get(each.row.index))),
        elsewhere=tuple(each.row.index for each in sample if each.row.device != device_kind()),
    )


def _flips(
    both: Sequence[SampledEpisode], lanes: Sequence[ComparedLane], theirs: Driven
) -> tuple[tuple[Flip, ...], tuple[Flip, ...]]:
    """Returns the episodes whose success differs from C MuJoCo's, and those that ended otherwise with the same one."""
    flips: list[Flip] = []
    others: list[Flip] = []
    for each, lane in zip(both, lanes, strict=True):
        row, end, reference = each.row, _end_of(each.row), _end_of(theirs[each.row.index].row)
        if lane.row.passed != lane.reference.passed:
            chaotic = any(drive.passed == lane.row.passed for drive in lane.disturbed) if lane.disturbed else None
            flips.append(Flip(index=row.index, row=end, reference=reference, chaotic=chaotic))
        elif end != reference:
            others.append(Flip(index=row.index, row=end, reference=reference))
    return tuple(flips), tuple(others)


def _compared_lane(each: SampledEpisode, theirs: Driven, control: Iterable[Driven]) -> ComparedLane:
    index = each.row.index
    return ComparedLane(
        episode=index,
        weight=each.weight,
        row=_ending(each.row),
        reference=_ending(theirs[index].row),
        disturbed=tuple(_ending(drive[index].row) for drive in control if index in drive),
    )


def _ending(row: EpisodeResult) -> Ending:
    return Ending(passed=bool(success(row)), touched=row.collisions > 0)


def _passed(ending: Ending) -> bool:
    return ending.passed


def _did_not_pass(ending: Ending) -> bool:
    return not ending.passed


def _untouched(ending: Ending) -> bool:
    return not ending.touched


def _control_found(
    lanes: Sequence[ComparedLane], theirs: Driven, control: Sequence[Driven], unflipped_m: Mapping[int, float]
) -> AuditControl | None:
    """Returns C MuJoCo compared with itself, over the lanes that it drove in each direction; None if there is none."""
    driven = [lane for lane in lanes if control and len(lane.disturbed) == len(control)]
    if not driven:
        return None
    own_m = {k: max(_most_apart_m(drive[k], theirs[k]) for drive in control) for k in (lane.episode for lane in driven)}
    rate = own_rate(driven)
    lower, upper = share_bounds(rate, weight_of(driven) ** 2 / sum(lane.weight**2 for lane in driven), CONFIDENCE)
    calm_m = [apart_m for index, apart_m in unflipped_m.items() if own_m.get(index, np.inf) <= CALM_M]
    return AuditControl(
        lanes=len(driven),
        drives=len(control),
        flips=sum(len({lane.reference.passed, *(each.passed for each in lane.disturbed)}) > 1 for lane in driven),
        rate=rate,
        lower=lower,
        upper=upper,
        way=apart_quantiles([*own_m.values()]),
        calm=len(calm_m),
        parted=sum(apart_m > APART_LIMIT_M for apart_m in calm_m),
    )


def _unlocked(row: EpisodeResult, again: DrivenEpisode | None) -> bool:
    """Returns whether lock-step did not hold in an episode, when its row was made or when it was driven again."""
    rows = [row, again.row] if again else [row]
    return any(each.late or each.stray for each in rows)


def _end_of(row: EpisodeResult) -> str:
    return row.outcome_reason or row.outcome


def _ends_apart_m(row: EpisodeResult, other: EpisodeResult) -> float:
    return float(np.hypot(row.final_x_m - other.final_x_m, row.final_y_m - other.final_y_m))


def _most_apart_m(ours: DrivenEpisode, theirs: DrivenEpisode) -> float:
    steps = min(len(ours.places_m), len(theirs.places_m))
    return float(np.hypot(*(ours.places_m[:steps] - theirs.places_m[:steps]).T).max(initial=0.0))


def _reproduced(row: EpisodeResult, ours: Driven) -> bool:
    if row.index not in ours:
        return False
    again = ours[row.index].row
    if device_kind() == "gpu":
        return row.model_dump(include=_ENDS) == again.model_dump(include=_ENDS)
    return row.model_dump(exclude=_BESIDES) == again.model_dump(exclude=_BESIDES)


UNDISTURBED_M = (0.0, 0.0)


class Drives:
    """Drives episodes while others are made ready; a context that ends when all that was begun has ended.

    So many parts as there are cores are under way at a time, which bounds the memory that they take.
    """

    def __init__(self) -> None:
        """Begins with none."""
        self._most = device_count()
        self._threads = ThreadPoolExecutor(self._most, "simyard audit")
        self._under_way: set[Future[list[DrivenEpisode]]] = set()

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, where: TracebackType | None
    ) -> None:
        """Waits for what was begun."""
        self._threads.shutdown(cancel_futures=True)

    def begin(
        self,
        requests: Sequence[EpisodeRequest],
        worlds: Mapping[str, World],
        bundles: Mapping[str, Path],
        *,
        lanes: int,
        engine: str,
        beside_m: tuple[float, float] = UNDISTURBED_M,
    ) -> Callable[[], dict[int, DrivenEpisode]]:
        """Returns what waits until episodes are driven, and returns them, as ``audit_drive.drive_sample`` does.

        Raises:
            BundleCrash: An application does not import, or raises when it is traced.
        """
        lanes = min(lanes, most_lanes(requests, bundles) or lanes)
        parts = [
            self._begin_part(ready, ready.run)
            for chunk in plan_chunks(requests, lanes)
            for ready in ready_parts(chunk.requests, worlds, bundles, lanes=lanes, engine=engine, beside_m=beside_m)
            if ready.run is not None
        ]
        return lambda: {each.row.index: each for part in parts for each in part.result()}

    def _begin_part(self, chunk: ReadyChunk, run: Run) -> Future[list[DrivenEpisode]]:
        if run.host is not None:
            part: Future[list[DrivenEpisode]] = Future()
            with open_run(run):
                drive = _to_end(LaneDrive(chunk, run))
            part.set_result(_driven_episodes(drive, run))
            return part
        drive = LaneDrive(chunk, run)
        drive.advance()
        while len(self._under_way) >= self._most:
            self._under_way -= wait(self._under_way, return_when=FIRST_COMPLETED).done
        part = self._threads.submit(copy_context().run, lambda: _driven_episodes(_to_end(drive), run))
        self._under_way.add(part)
        return part


def _to_end(drive: LaneDrive) -> LaneDrive:
    while not drive.done:
        drive.advance()
    return drive


def _driven_episodes(drive: LaneDrive, run: Run) -> list[DrivenEpisode]:
    chunk, end, path = drive.chunk, drive.end(), np.concatenate(drive.poses, axis=1)
    note_timing(chunk.watch.timing(chunk.program.lanes))
    return [
        DrivenEpisode(
            engine=chunk.program.engine,
            row=lane_row(chunk.program, run.host, lane, position, end, drive.poses),
            places_m=path[position, : int(end.step[position]), :2],
        )
        for position, lane in enumerate(chunk.lanes)
    ]


logger = logging.getLogger(__name__)
DISTURBANCES_M = ((1e-6, 0.0), (0.0, 1e-6))
"""Where the control starts, from where the episode does (x, y): far below what any map or sensor knows."""


def drive_sample(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    beside_m: tuple[float, float] = UNDISTURBED_M,
) -> dict[int, DrivenEpisode]:
    """Returns episodes driven to their ends, by index; without those that could not start.

    Args:
        requests: Any of a batch.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: Of a program.
        engine: ``auto``, or the engine that must drive them.
        beside_m: How far from its place each robot starts (x, y).

    Raises:
        BundleCrash: An application does not import, or raises when it is traced.
    """
    with Drives() as drives:
        return drives.begin(requests, worlds, bundles, lanes=lanes, engine=engine, beside_m=beside_m)()


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
        lanes: Of a program. With those of the batch, the engine drives the sample in the batch's own programs, which
            are there already, or in one of a quarter of the lanes, which whoever recounts the batch takes, too; C
            MuJoCo drives it in one with no more lanes than there are episodes.
        engine: What the batch asked for.
        drawn: How many episodes were to be audited, if more than the sample: worlds may be gone.
        progress: Told how many of two drives for each episode are done, or will not be made.

    Raises:
        BundleCrash: An application that made rows before now fails.
    """
    here = [each for each in sample if each.row.device == device_kind()]
    others = [each.request for each in sample if each.row.engine != REFERENCE]
    few = min(lanes, len(sample))
    theirs: Driven = {}
    why = f"the rows were made by {REFERENCE}, the reference itself"
    with Drives() as drives:
        began_theirs: Callable[[], Driven] | None = None
        if others:  # first, because it takes longer
            try:
                began_theirs = drives.begin(others, worlds, bundles, lanes=few, engine=REFERENCE)
            except BundleCrash as crash:
                why = crash.reason
        ours = drives.begin([each.request for each in here], worlds, bundles, lanes=lanes, engine=engine)()
        progress(len(here))
        if began_theirs:
            theirs = began_theirs()
    progress(2 * len(sample))
    found = findings(sample, ours, theirs, (), max(drawn, len(sample)))
    if needs_control(found):
        again = [each for each in others if each.index in theirs]
        found = findings(sample, ours, theirs, _control(again, worlds, bundles, few), found.sampled)
    return with_verdict(found, why)


def _control(
    requests: Sequence[EpisodeRequest], worlds: Mapping[str, World], bundles: Mapping[str, Path], lanes: int
) -> list[Driven]:
    """Returns what C MuJoCo makes of episodes from a micrometre beside, in each direction; nothing if it cannot.

    All lanes are driven, and not only those that flipped: of these alone one could not tell a flip that is rare
    everywhere from one that is the engine's.
    """
    try:
        return [
            drive_sample(requests, worlds, bundles, lanes=lanes, engine=REFERENCE, beside_m=beside_m)
            for beside_m in DISTURBANCES_M
        ]
    except BundleCrash as crash:
        logger.warning("the audit has no control: %s", crash.reason)
        return []
