"""The plan of a deployment job, and the rules of its waves: pure functions and data.

The plan is written into the job's record before the first robot is asked. The rules say which robots start next, which
never will, and when the roll-out is over.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from pydantic import Field

from specs.base import Spec
from specs.field_types import Architecture, S3Object
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.states import RobotProgress, RobotRecord

OperatorCommand = Literal["go", "pause", "cancel", "time out"]
"""What is wanted of a roll-out; ``time out`` when the fleet's time is over."""
FLEET_TIMEOUT_S = 30 * 86_400.0  # docs/reference/robomaker.md, section 8


# In flight at most ``max(1, floor(share x robots))``; ``ceil(threshold x robots)`` failures stop new starts, those in
# flight finish, and the rest is aborted (docs/reference/robomaker.md, section 8). When every robot has ended, both
# questions are always asked, so no roll-out can end without a verdict.
#
# Beyond RoboMaker: canaries go first, and one failure among them stops everything; failures may be made to count only
# after so many robots have ended (Greengrass calls that the minimum number of executed things); an operator may pause
# a roll-out, or cancel it.
class Phase(Enum):
    """Where a robot is in a roll-out; FAILED also stands for a robot that does not answer."""

    WAITING = "waiting"
    IN_FLIGHT = "in flight"
    IN_SYNC = "in sync"
    FAILED = "failed"
    ABORTED = "aborted"


@dataclass(frozen=True)
class Limits:
    """A roll-out's bounds, in robots.

    Attributes:
        at_once: How many may be in flight, at least 1.
        failures: How many failures stop it, at least 1.
        canaries: How many robots, the fleet's first, must be in sync before any other starts.
        least_ended: How many robots must have ended before failures stop it.
    """

    at_once: int
    failures: int
    canaries: int = 0
    least_ended: int = 0


@dataclass(frozen=True)
class Move:
    """What a controller does next.

    Attributes:
        start: Robots to ask now.
        abort: Robots that will not be asked.
        verdict: How the roll-out ended, or None while robots are waiting or in flight.
        why: What stopped it, where it was stopped.
    """

    start: tuple[str, ...] = ()
    abort: tuple[str, ...] = ()
    verdict: Literal["Succeeded", "Failed", "Canceled"] | None = None
    why: Literal["", "threshold", "canary", "time", "canceled"] = ""


def limits(robots: int, *, concurrent_percent: int, threshold_percent: int) -> Limits:
    """Returns the bounds for a fleet of so many robots; percentages are from 1 to 100."""
    return Limits(
        at_once=max(1, robots * concurrent_percent // 100),
        failures=max(1, -(-robots * threshold_percent // 100)),
    )


def next_move(phases: Mapping[str, Phase], bounds: Limits, command: OperatorCommand = "go") -> Move:
    """Returns what to do next for robots in these phases; robots start in the mapping's order.

    Args:
        phases: Where each robot is, in the fleet's order.
        bounds: What the roll-out keeps to.
        command: What is wanted of it; paused, it starts no robot, and ends only when none is left to start.
    """
    waiting = tuple(robot for robot, phase in phases.items() if phase is Phase.WAITING)
    in_flight = sum(phase is Phase.IN_FLIGHT for phase in phases.values())
    why = _stopped_by(phases, bounds, command)
    if why:
        # Those that were asked finish: half an installation is worse than the wrong one.
        verdict = None if in_flight else "Canceled" if why == "canceled" else "Failed"
        return Move(abort=waiting, verdict=verdict, why=why)
    if waiting and command == "pause":
        return Move()
    if waiting:
        return Move(start=_allowed(phases, bounds, waiting)[: max(0, bounds.at_once - in_flight)])
    return Move() if in_flight else Move(verdict="Succeeded")


def _stopped_by(
    phases: Mapping[str, Phase], bounds: Limits, command: OperatorCommand
) -> Literal["", "threshold", "canary", "time", "canceled"]:
    """Returns what stops a roll-out; nothing while it may go on."""
    count = Counter(phases.values())
    left = count[Phase.WAITING] + count[Phase.IN_FLIGHT]
    enough = not left or count[Phase.IN_SYNC] + count[Phase.FAILED] >= bounds.least_ended
    if command == "cancel":
        return "canceled"
    if any(phase is Phase.FAILED for phase in _canaries(phases, bounds)):
        return "canary"
    if count[Phase.FAILED] >= bounds.failures and enough:
        return "threshold"
    if command == "time out" and (count[Phase.WAITING] or count[Phase.ABORTED]):
        return "time"
    # Somebody was left out before: whatever it was for, it stays so.
    return "threshold" if count[Phase.ABORTED] else ""


def _allowed(phases: Mapping[str, Phase], bounds: Limits, waiting: tuple[str, ...]) -> tuple[str, ...]:
    """Returns which of the waiting robots may start: canaries alone until all of them are in sync."""
    if all(phase is Phase.IN_SYNC for phase in _canaries(phases, bounds)):
        return waiting
    return tuple(robot for robot in list(phases)[: bounds.canaries] if phases[robot] is Phase.WAITING)


def _canaries(phases: Mapping[str, Phase], bounds: Limits) -> list[Phase]:
    return list(phases.values())[: bounds.canaries]


class RolloutPlan(Spec):
    """What a deployment job does; written into its record before the first robot is asked, and the same ever after.

    Attributes:
        digest: Of the bundle that was tested, and that a robot gets where there are no builds.
        builds: The digest of the bundle for each architecture; empty for a bundle that is the same on all.
        digests: Of the bundle that each robot gets; a robot whose architecture has no build is missing. Empty where
            there are no builds.
        environments: The robots in the order in which they are asked, each with the variables its application gets.
        at_once: How many robots may be in flight.
        failures: How many failures stop the roll-out.
        timeout_s: How long one robot may take.
        canaries: How many robots must be in sync before any other is asked.
        least_ended: How many robots must have ended before failures stop the roll-out.
        fleet_timeout_s: How long the fleet may take.
    """

    fleet: str
    application: str
    version: int
    digest: str
    builds: dict[Architecture, str] = Field(default_factory=dict)
    digests: dict[str, str] = Field(default_factory=dict)
    launch: DeploymentLaunchConfig
    environments: dict[str, dict[str, str]]
    condition: S3Object | None = None
    at_once: int
    failures: int
    timeout_s: float
    canaries: int = 0
    least_ended: int = 0
    fleet_timeout_s: float = FLEET_TIMEOUT_S

    def digest_for(self, robot: str) -> str | None:
        """Returns the digest of the bundle that a robot gets; None when there is none for its architecture."""
        return self.digests.get(robot) if self.builds else self.digest

    def lacking(self) -> dict[str, RobotProgress]:
        """Returns the robots that cannot be asked because there is no bundle for them: they have failed already."""
        reason = f"the version has bundles for {', '.join(self.builds)}, and none for this robot's architecture"
        failed = RobotProgress(
            status="Failed", failure_code="MissingRobotApplicationArchitecture", failure_reason=reason
        )
        return {robot: failed for robot in self.environments if self.digest_for(robot) is None}

    @property
    def limits(self) -> Limits:
        """Returns the roll-out's bounds."""
        return Limits(self.at_once, self.failures, self.canaries, self.least_ended)


def digests_for(robots: Iterable[RobotRecord], builds: Mapping[Architecture, str]) -> dict[str, str]:
    """Returns the digest of the bundle that each robot gets, without those for whose architecture there is none."""
    return {robot.name: builds[robot.architecture] for robot in robots if robot.architecture in builds}
