"""The mechanical state of a lane's robot, and what the physics of a control step did to it."""

from typing import NamedTuple

import jax
from jaxtyping import Float

from tasks.simulate.application.contract import Joints


class Body(NamedTuple):
    """The robot's mechanical state, and what the solver starts from.

    Attributes:
        qpos: Pose of its base: (x m, y m, yaw rad).
        qvel: How that moves along the world's axes.
        warmstart: The last accelerations; an engine that keeps its own state has none.
        joints: Of a robot that is more than a planar base; None for the others.
    """

    qpos: Float[jax.Array, "3"]
    qvel: Float[jax.Array, "3"]
    act: Float[jax.Array, "activations"]
    warmstart: Float[jax.Array, "speeds"]
    joints: Joints | None = None


class Work(NamedTuple):
    """What a control step's physics did.

    Attributes:
        impulse_ns: How much contacts pushed the robot in the plane, whichever way.
        push_ns: The same as a vector along the world's axes: where it was pushed to, pushes against each other apart.
        energy_j: What its actuators spent.
    """

    impulse_ns: Float[jax.Array, ""]
    push_ns: Float[jax.Array, "2"]
    energy_j: Float[jax.Array, ""]


class Motion(NamedTuple):
    """What an engine makes of a control step.

    Attributes:
        body: The robot at the step's end.
        clearance_m: From its hull to the nearest solid then, seen from above; below 0 where they overlap.
    """

    body: Body
    work: Work
    clearance_m: Float[jax.Array, ""]
