"""What the record of a batch says of its parity audit: how far two engines are apart, and which outcomes flip."""

from collections.abc import Mapping
from typing import Literal

from pydantic import JsonValue

from specs.base import Spec

AuditVerdict = Literal["SOUND", "SUSPECT", "NOT COMPARED", "NOT RUN"]


class FlipShare(Spec):
    """Of the episodes that show something by their rows: how many do not show it on C MuJoCo.

    Attributes:
        lanes: Those that were compared.
        flips: How many of them do not show it on C MuJoCo.
        chaotic: Of these, lanes that do show it on C MuJoCo a micrometre beside: C MuJoCo flips them by itself.
        episodes: For how many of the batch's episodes the lanes stand.
        effective: To how many equally weighted lanes they come.
        rate: The weighted share of flips, 0-1; None of no lanes.
        beyond: The weighted share of flips that are not chaotic.
        lower, upper: The 95 % interval of the rate.
        chance: How often an engine that is as good as C MuJoCo would flip so many, by the control; None without one.
    """

    lanes: int = 0
    flips: int = 0
    chaotic: int = 0
    episodes: float = 0.0
    effective: float = 0.0
    rate: float | None = None
    beyond: float | None = None
    lower: float = 0.0
    upper: float = 1.0
    chance: float | None = None

    @property
    def unexplained(self) -> int:
        """Returns the flips that are not chaotic."""
        return self.flips - self.chaotic

    def text(self) -> str:
        """Returns such as ``1 of 16``."""
        return f"{self.flips} of {self.lanes}"


class TotalShare(Spec):
    """The share of a batch's episodes whose success is another one on C MuJoCo, with its 95 % interval."""

    rate: float | None = None
    lower: float = 0.0
    upper: float = 1.0


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
        differing: Columns in which they differ.
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
    reference: str = "mujoco"
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
    differing: tuple[str, ...] = ()
    ros: int = 0
    unlocked: tuple[int, ...] = ()
    elsewhere: tuple[int, ...] = ()
    spread: AuditFlipRate | None = None
    failed: AuditFlipRate | None = None


def audit_report(detail: Mapping[str, JsonValue]) -> AuditReport | None:
    """Returns the audit that a batch's record holds; None if there was none."""
    said = detail.get("audit")
    return AuditReport.model_validate(said) if said else None
