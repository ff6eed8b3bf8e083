"""The report of an audit: how far two engines are apart, which outcomes flip, and what C MuJoCo itself flips."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from specs.base import Spec
from tasks.simulate.audit.audit_estimate import FlipShare, TotalShare
from tasks.simulate.engine.engines import REFERENCE

AuditVerdict = Literal["SOUND", "SUSPECT", "NOT COMPARED", "NOT RUN"]


class ApartQuantiles(Spec):
    """How far apart the robots of two engines were, over the lanes of a sample (m)."""

    median_m: float
    p90_m: float
    max_m: float


class Flip(Spec):
    """An episode that came to another end on C MuJoCo.

    Attributes:
        index: The episode's.
        row: ``Passed``, or why it failed.
        reference: The same on C MuJoCo.
        chaotic: Whether C MuJoCo a micrometre beside agrees with the row; None where there was no control.
    """

    index: int
    row: str
    reference: str
    chaotic: bool | None = None


class AuditFlipRate(Spec):
    """How many of some episodes flipped, as reports of older versions have it."""

    lanes: int
    flips: int


class AuditControl(Spec):
    """C MuJoCo compared with itself, started a micrometre beside.

    Attributes:
        lanes: Episodes that it drove so, in each direction.
        drives: Directions.
        flips: Lanes in which its own drives differ in success.
        rate: How likely two of its drives differ in success, weighted as the batch.
        lower, upper: The 95 % interval of the rate.
        way: How far its drives were from the undisturbed one, in the direction where it was furthest.
        calm: Lanes that came to the same end on both engines, and that its own drives keep together.
        parted: Of these, lanes in which the row's engine is far from it all the same.
    """

    lanes: int
    drives: int
    flips: int
    rate: float
    lower: float
    upper: float
    way: ApartQuantiles | None = None
    calm: int = 0
    parted: int = 0


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
        false_passes: Of those that passed: how many fail on the reference.
        false_alarms: Of those that failed: how many pass on the reference.
        missed_contacts: Of those that touched nothing: how many touch something on the reference.
        total: The share of the batch's episodes whose success is another one on the reference.
        control: The reference compared with itself; None where nothing had to be explained.
        final: Between the places where episodes ended; None if none was compared.
        way: The most at any control step that both had; None likewise.
        unflipped: The same of the episodes that came to the same end on both.
        flips: Episodes whose success is another one on the reference.
        others: Episodes with the same success that came to another end.
        unreproduced: Episodes whose row is not what the engine makes of their request.
        ros: Episodes that a ROS application drove.
        unlocked: Those of them in which lock-step did not hold, when their rows were made or when they were driven
            again: that their rows are the same is then no promise.
        elsewhere: Episodes that another kind of device had driven, whose bits cannot be had again here.
        spread: In reports of older versions: of episodes spread over the batch, how many came to another end.
        failed: Likewise: of those that failed.
    """

    verdict: AuditVerdict
    sentence: str
    sampled: int = 0
    engine: str = ""
    reference: str = REFERENCE
    lanes: int = 0
    compared: int = 0
    false_passes: FlipShare = FlipShare()
    false_alarms: FlipShare = FlipShare()
    missed_contacts: FlipShare = FlipShare()
    total: TotalShare = TotalShare()
    control: AuditControl | None = None
    final: ApartQuantiles | None = None
    way: ApartQuantiles | None = None
    unflipped: ApartQuantiles | None = None
    flips: tuple[Flip, ...] = ()
    others: tuple[Flip, ...] = ()
    unreproduced: tuple[int, ...] = ()
    ros: int = 0
    unlocked: tuple[int, ...] = ()
    elsewhere: tuple[int, ...] = ()
    spread: AuditFlipRate | None = None
    failed: AuditFlipRate | None = None


def not_run(why: str) -> AuditReport:
    """Returns the report of an audit that could not be made."""
    return AuditReport(verdict="NOT RUN", sentence=f"not run: {' '.join(why.split())[:500]}")


def apart_quantiles(apart_m: Sequence[float]) -> ApartQuantiles | None:
    """Returns the quantiles of distances; None of none."""
    if not apart_m:
        return None
    median, p90, most = np.quantile(apart_m, [0.5, 0.9, 1.0])
    return ApartQuantiles(median_m=float(median), p90_m=float(p90), max_m=float(most))
