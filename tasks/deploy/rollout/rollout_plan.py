"""The plan of a deployment job, written into its record before the first robot is asked."""

from collections.abc import Iterable, Mapping

from pydantic import Field

from specs.base import Spec
from specs.field_types import Architecture, S3Object
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.states import RobotProgress, RobotRecord
from tasks.deploy.rollout.waves import Limits

FLEET_TIMEOUT_S = 30 * 86_400.0  # docs/reference/robomaker.md, section 8


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
