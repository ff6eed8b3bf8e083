"""What the drives of an audit show beside each other: flips, distances, rows that could not be made again."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from specs.data.episode import EpisodeResult, success
from tasks.simulate.audit.audit_estimate import (
    CONFIDENCE,
    ComparedLane,
    Ending,
    flip_share,
    own_rate,
    share_bounds,
    total_share,
    weight_of,
)
from tasks.simulate.audit.audit_report import AuditControl, AuditReport, Flip, apart_quantiles
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.audit.audit_verdict import APART_LIMIT_M, CALM_M
from tasks.simulate.devices import device_kind
from tasks.simulate.engine.engines import REFERENCE

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
        control=_control(lanes, theirs, control, unflipped_m),
        final=apart_quantiles([_apart_m(each.row, theirs[each.row.index].row) for each in both]),
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
        row, end, reference = each.row, _end(each.row), _end(theirs[each.row.index].row)
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


def _control(
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


def _end(row: EpisodeResult) -> str:
    return row.outcome_reason or row.outcome


def _apart_m(row: EpisodeResult, other: EpisodeResult) -> float:
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
