"""The report of an audit: what a sample says of its batch, in numbers, and the verdict on them.

The share of episodes that come out otherwise on C MuJoCo is estimated, and whether that is chaos. Lanes are weighted by
what they stand for, so that the estimates are those of the batch. A control tells chaos from an engine's error: C
MuJoCo drives the lanes again, a micrometre beside. An engine that is as good as C MuJoCo is just one more of these
drives.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from specs.data.column_bytes import decode_columns, encode_columns
from specs.data.episode import EpisodeResult, success
from specs.data.episode_columns import EpisodeColumns
from specs.data.parity_audit import (
    ApartQuantiles,
    AuditControl,
    AuditReport,
    AuditVerdict,
    Flip,
    FlipShare,
    TotalShare,
)
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.devices import device_kind
from tasks.simulate.engines.engine_table import REFERENCE

CONFIDENCE = 0.95
"""Coverage of the intervals of a report; a gate computes its own."""


class Ending(NamedTuple):
    """What came of an episode on an engine: whether it passed, and whether the robot touched anything."""

    passed: bool
    touched: bool


Trait = Callable[[Ending], bool]


class ComparedLane(NamedTuple):
    """An episode on its own engine and on C MuJoCo.

    Attributes:
        episode: Its index.
        weight: For how many of the batch's episodes it stands.
        row: By the engine that made its row.
        reference: By C MuJoCo.
        disturbed: By C MuJoCo a micrometre beside, in each direction; none where there was no control.
    """

    episode: int
    weight: float
    row: Ending
    reference: Ending
    disturbed: tuple[Ending, ...] = ()


def flip_share(lanes: Sequence[ComparedLane], trait: Trait) -> FlipShare:
    """Returns how many of the lanes with a trait have it not on C MuJoCo.

    Args:
        lanes: All compared lanes, those without the trait too: what chance does is seen in them as well.
        trait: What an ending shows or not.
    """
    own = [lane for lane in lanes if trait(lane.row)]
    if not own:
        return FlipShare()
    flipped = [lane for lane in own if not trait(lane.reference)]
    chaotic = [lane for lane in flipped if any(map(trait, lane.disturbed))]
    all_of = weight_of(own)
    rate, effective = weight_of(flipped) / all_of, all_of**2 / sum(lane.weight**2 for lane in own)
    lower, upper = share_bounds(rate, effective, CONFIDENCE)
    return FlipShare(
        lanes=len(own),
        flips=len(flipped),
        chaotic=len(chaotic),
        episodes=all_of,
        effective=effective,
        rate=rate,
        beyond=rate - weight_of(chaotic) / all_of,
        lower=lower,
        upper=upper,
        chance=chance_of(lanes, trait) if any(lane.disturbed for lane in lanes) else None,
    )


def total_share(strata: Sequence[FlipShare]) -> TotalShare:
    """Returns the share of flips over strata, each weighted by its episodes.

    The interval joins those of the strata by their distances from the estimates (Zou and Donner 2008, Statistics in
    Medicine 27:1693, section 2).
    """
    present = [each for each in strata if each.rate is not None]
    episodes = sum(each.episodes for each in present)
    if not episodes:
        return TotalShare()
    rate, below, above = 0.0, 0.0, 0.0
    for each in present:
        share, estimate = each.episodes / episodes, each.rate or 0.0
        rate += share * estimate
        below += (share * (estimate - each.lower)) ** 2
        above += (share * (each.upper - estimate)) ** 2
    return TotalShare(rate=rate, lower=max(0.0, rate - math.sqrt(below)), upper=min(1.0, rate + math.sqrt(above)))


def share_bounds(rate: float, effective: float, confidence: float) -> tuple[float, float]:
    """Returns the two-sided interval of a weighted share; ``tasks.results.statistics.intervals`` says the same.

    The exact interval of Clopper and Pearson 1934 (Biometrika 26:404), whose bounds are quantiles of beta
    distributions, with the effective number of lanes (Korn and Graubard 1998, Survey Methodology 24:193).

    Args:
        rate: As it was seen, 0-1.
        effective: To how many equally weighted lanes they come, above 0.
        confidence: Coverage, between 0 and 1.
    """
    # The same bits as scipy.stats.beta.ppf, whose import takes a second.
    from scipy.special import betaincinv  # noqa: PLC0415 - whoever reads a report needs no interval

    tail, seen = (1.0 - confidence) / 2.0, rate * effective
    lower = float(betaincinv(seen, effective - seen + 1.0, tail)) if seen > 0.0 else 0.0
    upper = float(betaincinv(seen + 1.0, effective - seen, 1.0 - tail)) if seen < effective else 1.0
    return lower, upper


def own_rate(lanes: Sequence[ComparedLane]) -> float:
    """Returns the weighted chance that two drives of C MuJoCo, a micrometre apart, differ in success.

    Of each lane's drives all pairs count, which is without bias (Hoeffding 1948, Annals of Mathematical Statistics
    19:293).

    Args:
        lanes: With their disturbed drives, at least one lane.
    """
    total = 0.0
    for lane in lanes:
        drives = [lane.reference.passed, *(each.passed for each in lane.disturbed)]
        total += lane.weight * 2 * sum(drives) * drives.count(False) / (len(drives) * (len(drives) - 1))
    return total / weight_of(lanes)


def weight_of(lanes: Sequence[ComparedLane]) -> float:
    """Returns for how many episodes lanes stand."""
    return sum(lane.weight for lane in lanes)


def chance_of(lanes: Sequence[ComparedLane], trait: Trait) -> float:
    """Returns how often so many flips would be seen, were the row's engine just one more disturbed C MuJoCo.

    Then each of a lane's drives might have been the row, so that the null distribution comes from exchanging them
    (Fisher 1935, The Design of Experiments, section 21). Each drive counts by how likely the lane would have been
    drawn, had it been the row: rare failures are drawn more often, and many of them do not happen again. What is added
    up over the lanes whose rows have the trait is how many drives on C MuJoCo have it not.

    Args:
        lanes: With their disturbed drives.
        trait: What an ending shows or not.
    """
    drawn = _drawn_shares(lanes)
    seen, sums = 0, np.ones(1)
    for lane in lanes:
        drives = [lane.row, lane.reference, *lane.disturbed]
        having = [each for each in drives if trait(each)]
        lack = len(drives) - len(having)
        if not having or not lack:
            continue
        seen += lack if trait(lane.row) else 0
        share = sum(drawn[each.passed] for each in having) / sum(drawn[each.passed] for each in drives)
        sums = np.convolve(sums, [1.0 - share, *[0.0] * (lack - 1), share])
    return min(1.0, float(sums[seen:].sum()))


def _drawn_shares(lanes: Sequence[ComparedLane]) -> Mapping[bool, float]:
    """Returns how likely an episode is drawn, by whether it passed; of a kind that there is none of, all are."""
    shares: dict[bool, float] = {}
    for passed in (True, False):
        own = [lane for lane in lanes if lane.row.passed == passed]
        shares[passed] = len(own) / weight_of(own) if own else 1.0
    return shares


def not_run(why: str) -> AuditReport:
    """Returns the report of an audit that could not be made."""
    return AuditReport(verdict="NOT RUN", sentence=f"not run: {' '.join(why.split())[:500]}")


def apart_quantiles(apart_m: Sequence[float]) -> ApartQuantiles | None:
    """Returns the quantiles of distances; None of none."""
    if not apart_m:
        return None
    median, p90, most = np.quantile(apart_m, [0.5, 0.9, 1.0])
    return ApartQuantiles(median_m=float(median), p90_m=float(p90), max_m=float(most))


# Flips are no surprise in chaotic contacts, so that one is no alarm. It is raised by flips that C MuJoCo does not show
# by itself, when chance would give so many less often than that: were the true rate within its limit, and were the
# engine one more C MuJoCo, disturbed.
FLIP_LIMIT, FAILED_FLIP_LIMIT = 0.01, 0.05
FEWEST_FLIPS = 2
CHANCE = 0.05
# Engines that agree are micrometres apart, where no contact amplifies them into another end.
APART_LIMIT_M = 0.05
# C MuJoCo's own drives, a micrometre apart at first, stay so near where nothing amplifies: a thousand times that.
CALM_M = 1e-3
PARTED_LIMIT = 0.1


def with_verdict(found: AuditReport, why_not_compared: str = "") -> AuditReport:
    """Returns a report with its verdict, and a sentence that says why.

    Args:
        found: The numbers.
        why_not_compared: Why there are none of the reference, if so.
    """
    alarms = _alarms(found)
    said = [f"{found.lanes} of {found.lanes} rows were the same when driven again"] if not found.unreproduced else []
    if found.compared:
        said = _compared(found)
    elif not found.unreproduced:
        said.append(f"not compared: {why_not_compared}" if why_not_compared else "not compared")
    drawn = max(found.sampled, found.lanes)
    enough = found.compared > 0 and 2 * found.compared >= drawn
    if found.compared and not enough:
        said.append(f"no more than {found.compared} of the {drawn} drawn could be compared")
    verdict: AuditVerdict = "SUSPECT" if alarms else "SOUND" if enough else "NOT COMPARED"
    sentence = "; ".join(part for part in (*alarms, *_warnings(found), *said) if part)
    return found.model_copy(update={"verdict": verdict, "sentence": sentence})


def needs_control(found: AuditReport) -> bool:
    """Returns whether there is anything that chaos might explain: a flip, a contact, robots that part."""
    return bool(found.flips) or found.missed_contacts.flips > 0 or _apart_m(found) > APART_LIMIT_M


def exceeds(share: FlipShare, limit: float) -> bool:
    """Returns whether so many flips that are not chaotic are hardly to be had by chance at a true rate within a limit.

    Args:
        share: The flips.
        limit: The rate, 0-1.
    """
    n, flips = share.lanes, share.unexplained
    fewer = sum(math.comb(n, k) * limit**k * (1.0 - limit) ** (n - k) for k in range(flips))
    return flips >= FEWEST_FLIPS and 1.0 - fewer < CHANCE


def _alarmed(share: FlipShare, limit: float) -> bool:
    return exceeds(share, limit) and (share.chance is None or share.chance < CHANCE)


def _alarms(found: AuditReport) -> list[str]:
    alarms: list[str] = []
    if found.unreproduced:
        alarms.append(
            f"{len(found.unreproduced)} of {found.lanes} rows are not what their engine makes of them "
            f"({_few(found.unreproduced)}){_columns(found.differing)}"
        )
    if _alarmed(found.false_passes, FLIP_LIMIT):
        alarms.append("episodes pass that fail on C MuJoCo, more often than a micrometre explains")
    if _alarmed(found.false_alarms, FAILED_FLIP_LIMIT):
        alarms.append("episodes fail that pass on C MuJoCo, more often than a micrometre explains")
    if _alarmed(found.missed_contacts, FLIP_LIMIT):
        alarms.append("robots touch nothing that touch something on C MuJoCo, more often than a micrometre explains")
    alarms += _parted(found)
    return alarms


def _columns(differing: Sequence[str]) -> str:
    return f", in {_few(differing)}: simyard replay drives one of them again and compares it" if differing else ""


def _parted(found: AuditReport) -> list[str]:
    """Returns the alarm that robots part which C MuJoCo keeps together; without a control, that they part."""
    control = found.control
    if control is None:
        said = f"robots with the same outcome are apart from C MuJoCo's by {_apart_m(found):.2g} m (p90)"
        return [said] * (_apart_m(found) > APART_LIMIT_M)
    said = f"robots in {control.parted} of {control.calm} lanes with the same outcome are more than {APART_LIMIT_M} m "
    said += "apart from C MuJoCo's, which stay together when they start a micrometre beside"
    return [said] * (control.parted >= max(FEWEST_FLIPS, PARTED_LIMIT * control.calm))


def _apart_m(found: AuditReport) -> float:
    return found.unflipped.p90_m if found.unflipped else 0.0


def _compared(found: AuditReport) -> list[str]:
    """Returns what a comparison came to: flips by direction, what C MuJoCo flips itself, how far robots are apart."""
    passes, failures = found.false_passes, found.false_alarms
    said = [f"{passes.text()} passes fail there ({_bounds(passes)})"] if passes.lanes else []
    said += [f"{failures.text()} failures pass there ({_bounds(failures)})"] if failures.lanes else []
    text = f"{found.compared} lanes on C MuJoCo: {', '.join(said)}" if said else f"{found.compared} lanes on C MuJoCo"
    parts = [text]
    if found.flips and found.control:
        chaotic = sum(bool(flip.chaotic) for flip in found.flips)
        lanes = "a lane" if chaotic == 1 else "lanes"
        verb = "is" if chaotic == 1 else "are"
        parts.append(f"{chaotic} of {len(found.flips)} flips {verb} of {lanes} that C MuJoCo itself flips")
    if found.way:
        parts.append(f"p90 {found.way.p90_m:.1g} m apart")
    return parts


def _bounds(share: FlipShare) -> str:
    return f"{100 * share.lower:.1f} to {100 * share.upper:.1f} %"


def _warnings(found: AuditReport) -> list[str]:
    """Returns what a person should know of rows that are the same: luck may have had a part in it."""
    if not found.unlocked:
        return []
    unlocked = f"lock-step did not hold in {len(found.unlocked)} of {found.ros} episodes ({_few(found.unlocked)})"
    return [f"{unlocked}: they may differ another time"]


def _few(some: Sequence[object]) -> str:
    return ", ".join(map(str, some[:5]))


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
        unreproduced=tuple(row.index for row in here if row.index not in ours or _differing(row, ours)),
        differing=tuple(dict.fromkeys(name for row in here if row.index in ours for name in _differing(row, ours))),
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


def _differing(row: EpisodeResult, ours: Driven) -> list[str]:
    """Returns the columns of a row that are not what its engine makes of its request."""
    here, again = row.model_dump(), ours[row.index].row.model_dump()
    compared = _ENDS if device_kind() == "gpu" else here.keys() - _BESIDES
    return [name for name in here if name in compared and here[name] != again[name]]


DRIVE_ARRAYS = 3


def drive_arrays(driven: Driven) -> list[np.ndarray]:
    """Returns a drive as arrays: the bytes of its rows, how many steps each did, and the places of all of them."""
    found = [*driven.values()]
    places_m = [each.places_m for each in found]
    return [
        np.frombuffer(encode_columns(EpisodeColumns.of([each.row for each in found])), np.uint8),
        np.array([*map(len, places_m)], np.int64),
        np.concatenate(places_m, dtype=np.float32) if places_m else np.zeros((0, 2), np.float32),
    ]


def received_drive(arrays: Sequence[np.ndarray], asked: Iterable[int]) -> Driven:
    """Returns the drive whose arrays a process sent.

    Args:
        arrays: As ``drive_arrays`` makes them, or anything else.
        asked: Indices of the episodes that were to be driven.

    Raises:
        ValueError: They are not those of a drive of some of these.
    """
    body, steps, places_m = arrays
    rows = decode_columns(body.tobytes()).rows()
    indices = [row.index for row in rows]
    if not set(indices) <= set(asked) or len(set(indices)) < len(indices):
        raise ValueError("a drive of other episodes")
    whole = steps.dtype == np.int64 and steps.shape == (len(rows),) and not (steps < 0).any()
    if not whole or places_m.dtype != np.float32 or places_m.shape != (steps.sum(), 2):
        raise ValueError("a drive whose places are not those of its rows")
    if not np.isfinite(places_m).all():
        raise ValueError("a drive to places that are none")
    ends = np.cumsum(steps)
    return {
        row.index: DrivenEpisode(row.engine, row, places_m[end - count : end])
        for row, count, end in zip(rows, steps.tolist(), ends.tolist(), strict=True)
    }


class AuditDrives(NamedTuple):
    """What drives of a sample made of it.

    Attributes:
        ours: By the engines that made the rows; without what another kind of device drove.
        theirs: By C MuJoCo; without what it had driven in the first place.
        why: Why C MuJoCo drove none; empty if it did, or had nothing to drive.
    """

    ours: Driven
    theirs: Driven
    why: str = ""


def audit_report(
    sample: Sequence[SampledEpisode],
    drives: AuditDrives,
    control: Callable[[], Sequence[Driven]],
    drawn: int = 0,
) -> AuditReport:
    """Returns what driving a sample again shows.

    Args:
        sample: At least one episode.
        drives: Of the sample.
        control: Has C MuJoCo drive what it drove from a micrometre beside, in each direction; nothing if it cannot.
        drawn: How many episodes were to be audited, if more than the sample: worlds may be gone.
    """
    ours, theirs, why = drives
    found = findings(sample, ours, theirs, (), max(drawn, len(sample)))
    if needs_control(found):
        found = findings(sample, ours, theirs, control(), found.sampled)
    return with_verdict(found, why or f"the rows were made by {REFERENCE}, the reference itself")
