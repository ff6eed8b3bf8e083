"""The mjx engine: any robot that MJX can step, in a window of the obstacles nearest to it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tasks.simulate.coordinates import placed, pose_of, velocity_of
from tasks.simulate.contract import Joints
from tasks.simulate.lane_state import Body, LaneInputs, Motion, Work
from tasks.simulate.model import BOX_SLOTS, CYLINDER_SLOTS, RobotModel
from tasks.simulate.quiet_mjx import mjx
from tasks.simulate.window import distance_m, nearest_obstacles, with_window


def first_body(robot: RobotModel, start: Float[jax.Array, "3"]) -> Body:
    """Returns a robot at rest at its start."""
    qpos, rest = placed(robot.base, jnp.asarray(robot.rest), start, jnp), jnp.zeros(robot.host.nv)
    return _body(robot, qpos, rest, jnp.asarray(robot.rest_act), rest)


def drive(robot: RobotModel, inputs: LaneInputs, body: Body, control: Float[jax.Array, "actuators"]) -> Motion:
    """Returns what a control step's physics does to a robot."""
    window = nearest_obstacles(inputs.boxes, inputs.cylinders, body.qpos[:2], BOX_SLOTS, CYLINDER_SLOTS)
    model = with_window(robot, window)
    step_s = model.opt.timestep

    def physics_step(carry: tuple[mjx.Data, Work], _: None) -> tuple[tuple[mjx.Data, Work], None]:
        before, work = carry
        data = mjx.step(model, before)
        push_n = _push_n(robot, data)
        force_n = jnp.sqrt(jnp.sum(push_n**2))
        worked = Work(
            work.impulse_ns + force_n * step_s,
            work.push_ns + push_n * step_s,
            work.energy_j + _power_w(data) * step_s,
        )
        return (data, worked), None
