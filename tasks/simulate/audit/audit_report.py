"""The report of an audit: how far two engines are apart, which outcomes flip, and whether that is alarming."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from specs.base import Spec
from tasks.simulate.engine.engines import REFERENCE

AuditVerdict = Literal["SOUND", "SUSPECT", "NOT COMPARED", "NOT RUN"]
# Flips are no surprise in chaotic contacts, so that one is no alarm: it is raised when so many would be seen by
# chance less often than that, were the true rate within its limit: 2 of 16 spread ones, 3 of 8 failed ones.
FLIP_LIMIT, FAILED_FLIP_LIMIT = 0.01, 0.05
FEWEST_FLIPS = 2
# Engines that agree are micrometres apart, where no contact amplifies them into another end.
APART_LIMIT_M = 0.05
_CHANCE = 0.05


class ApartQuantiles(Spec):
    """How far apart the robots of two engines were, over the lanes of a sample (m)."""

    median_m: float
    p90_m: float
    max_m: float


class Flip(Spec):
    """An episode that came to another end on C MuJoCo: ``Passed``, or why it failed."""

    index: int
    row: str
    reference: str


class AuditFlipRate(Spec):
    """How many of some episodes flipped."""

    lanes: int
    flips: int

    @property
    def rate(self) -> float | None:
        """Returns their share, 0-1; None of no episodes."""
        return self.flips / self.lanes if self.lanes else None

    def exceeds(self, limit: float) -> bool:
        """Returns whether so many flips are hardly to be had by chance at a true rate within the limit."""
        fewer = sum(math.comb(self.lanes, k) * limit**k * (1.0 - limit) ** (self.lanes - k) for k in range(self.flips))
        return self.flips >= FEWEST_FLIPS and 1.0 - fewer < _CHANCE

    def text(self) -> str:
        """Returns such as ``1 of 16``."""
        return f"{self.flips} of {self.lanes}"


class AuditReport(Spec):
    """What an audit found.

    Attributes:
        verdict: ``SOUND``; ``SUSPECT``: look at it before you rely on the batch; ``NOT COMPARED``: rows were made again
            at most, since the engine is the reference itself or nothing could be compared; ``NOT RUN``.
        sentence: The same, for a person.
        sampled: Episodes that were drawn.
        engine: Which made the rows, comma-separated where robots differ.
        reference: What it is compared with.
        lanes: Episodes that were driven again.
        compared: How many of them on the reference too.
        final: Between the places where episodes ended; None if none was compared.
        way: The most at any control step that both had; None likewise.
        unflipped: The same of the episodes that came to the same end on both.
        spread: Of episodes spread over the batch: an estimate for the batch.
        failed: Of those episodes of the sample that failed.
        flips: Episodes with another outcome.
        unreproduced: Episodes whose row is not what the engine makes of their request.
        ros: Episodes that a ROS application drove.
        unlocked: Those of them in which lock-step did not hold, when their rows were made or when they were driven
            again: that their rows are the same is then no promise.
        elsewhere: Episodes that another kind of device had driven, whose bits cannot be had again here.
    """

    verdict: AuditVerdict
    sentence: str
    sampled: int = 0
    engine: str = ""
    reference: str = REFERENCE
    lanes: int = 0
    compared: int = 0
    final: ApartQuantiles | None = None
    way: ApartQuantiles | None = None
    unflipped: ApartQuantiles | None = None
    spread: AuditFlipRate = AuditFlipRate(lanes=0, flips=0)
    failed: AuditFlipRate = AuditFlipRate(lanes=0, flips=0)
    flips: tuple[Flip, ...] = ()
    unreproduced: tuple[int, ...] = ()
    ros: int = 0
    unlocked: tuple[int, ...] = ()
    elsewhere: tuple[int, ...] = ()


def not_run(why: str) -> AuditReport:
    """Returns the report of an audit that could not be made."""
    return AuditReport(verdict="NOT RUN", sentence=f"not run: {' '.join(why.split())[:500]}")


def with_verdict(found: AuditReport, why_not_compared: str = "") -> AuditReport:
    """Returns a report with its verdict, and a sentence that says why.

    Args:
        found: The numbers.
        why_not_compared: Why there are none of the reference, if so.
    """
    alarms = _alarms(found)
    said = f"{found.lanes} of {found.lanes} rows were the same when driven again" if not found.unreproduced else ""
    if found.compared:
        p90 = f", p90 {found.way.p90_m:.1g} m apart" if found.way else ""
        failed = f", {found.failed.text()} failed ones" if found.failed.lanes else ""
        said = f"{found.compared} lanes on C MuJoCo: {found.spread.text()} outcomes flipped{failed}{p90}"
    elif not found.unreproduced:
        said += f"; not compared: {why_not_compared}" if why_not_compared else "; not compared"
    enough = found.compared > 0 and 2 * found.compared >= max(found.sampled, found.lanes)
    if found.compared and not enough:
        said += f"; no more than {found.compared} of the {max(found.sampled, found.lanes)} drawn could be compared"
    verdict: AuditVerdict = "SUSPECT" if alarms else "SOUND" if enough else "NOT COMPARED"
    sentence = "; ".join(part for part in (*alarms, *_warnings(found), said) if part)
    return found.model_copy(update={"verdict": verdict, "sentence": sentence})


def apart_quantiles(apart_m: Sequence[float]) -> ApartQuantiles | None:
    """Returns the quantiles of distances; None of none."""
    if not apart_m:
        return None
    median, p90, most = np.quantile(apart_m, [0.5, 0.9, 1.0])
    return ApartQuantiles(median_m=float(median), p90_m=float(p90), max_m=float(most))


def _warnings(found: AuditReport) -> list[str]:
    """Returns what a person should know of rows that are the same: luck may have had a part in it."""
    if not found.unlocked:
        return []
    unlocked = f"lock-step did not hold in {len(found.unlocked)} of {found.ros} episodes ({_few(found.unlocked)})"
    return [f"{unlocked}: they may differ another time"]


def _few(indices: Sequence[int]) -> str:
    return ", ".join(map(str, indices[:5]))


def _alarms(found: AuditReport) -> list[str]:
    alarms: list[str] = []
    if found.unreproduced:
        alarms.append(
            f"{len(found.unreproduced)} of {found.lanes} rows are not what their engine makes of them "
            f"({_few(found.unreproduced)})"
        )
    if found.spread.exceeds(FLIP_LIMIT) or found.failed.exceeds(FAILED_FLIP_LIMIT):
        alarms.append("outcomes differ from C MuJoCo's more often than chance explains")
    if found.unflipped is not None and found.unflipped.p90_m > APART_LIMIT_M:
        alarms.append(f"robots with the same outcome are apart from C MuJoCo's by {found.unflipped.p90_m:.2g} m (p90)")
    return alarms
