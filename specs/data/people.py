"""People who walk in the world of an episode: how many, how fast, and who of them sees the robot."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.field_types import Integer, Number

MOST_PEOPLE = 16
LEAST_PACE_M_S, MOST_PACE_M_S = 0.1, 2.0
PERSON_RADIUS_M = 0.25
"""Of the upright cylinder that stands for a person: half of the widest shoulders."""

PERSON_HEIGHT_M = 1.7

PERSONAL_M, INTIMATE_M = 1.2, 0.45
"""How near strangers and friends come to one another (E. Hall, The Hidden Dimension, 1966)."""

STANDING_M_S = 0.02
"""A robot that moves no faster stands still: it does nothing to who walks into it."""

FARTHEST_COLLISION_S = 60.0
"""A collision that would come later, or never, is told as one after so long."""

TRANSIENT_S = 0.5
"""How long an impact lasts at most; what presses for longer is quasi-static (ISO/TS 15066:2016, 5.5.5)."""


class People(Spec):
    """People who walk in the rooms while the robot drives."""

    count: Annotated[Integer, Field(ge=1, le=MOST_PEOPLE)] = Field(
        title="Count", description="How many walk in each world."
    )
    speed_ms: Annotated[Number, Field(ge=LEAST_PACE_M_S, le=MOST_PACE_M_S)] = Field(
        default=1.0, title="Speed (m/s)", description="How fast they walk; each has its own pace, a fifth more or less."
    )
    unaware: Annotated[Number, Field(ge=0.0, le=1.0)] = Field(
        default=0.0, title="Unaware", description="How probable it is of each of them not to see the robot."
    )
    model: Literal["orca", "recorded"] = Field(
        default="orca",
        title="Model",
        description="orca: they walk about, and keep clear of one another; recorded: as the world's walks say.",
    )
