"""What a roll-out may be asked for that RoboMaker's requests have no words for."""

from typing import Annotated

from pydantic import Field

from specs.base import Spec
from specs.common import Integer


class RollOutRules(Spec):
    """What a roll-out keeps to beyond RoboMaker's deploymentConfig."""

    canaryRobots: Annotated[Integer, Field(ge=0, le=1000)] = Field(
        default=0, title="Canaries", description="So many robots go first; a failure among them stops the roll-out."
    )
    leastExecutedRobots: Annotated[Integer, Field(ge=0, le=1000)] = Field(
        default=0,
        title="Least executed",
        description="The failure threshold counts once so many robots have ended.",
    )
