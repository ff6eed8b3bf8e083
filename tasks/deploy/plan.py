"""What a deployment job does, as its record holds it from before the first robot is asked."""

from specs.base import Spec
from specs.common import S3Object
from specs.deployment import DeploymentLaunchConfig
from tasks.deploy.rollout import Limits

FLEET_TIMEOUT_S = 30 * 86_400.0  # semantics 8


class Plan(Spec):
    """What a deployment job does; written into its record before the first robot is asked, and the same ever after.

    Attributes:
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
    launch: DeploymentLaunchConfig
    environments: dict[str, dict[str, str]]
    condition: S3Object | None = None
    at_once: int
    failures: int
    timeout_s: float
    canaries: int = 0
    least_ended: int = 0
    fleet_timeout_s: float = FLEET_TIMEOUT_S

    @property
    def limits(self) -> Limits:
        """Returns the roll-out's bounds."""
        return Limits(self.at_once, self.failures, self.canaries, self.least_ended)
