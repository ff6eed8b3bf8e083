"""The mjx engine: any planar base that MJX can step, in a window of the obstacles nearest to it."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.lane_state import Body, LaneInputs, Motion, Work
from tasks.simulate.model import BOX_SLOTS, CYLINDER_SLOTS, RobotModel
from tasks.simulate.quiet_mjx import mjx
from tasks.simulate.window import distance_m, nearest_obstacles, with_window


def drive(robot: RobotModel, inputs: LaneInputs, body: Body, control: Float[jax.Array, "actuators"]) -> Motion:
    """Returns what a control step's physics does to a robot."""
    window = nearest_obstacles(inputs.boxes, inputs.cylinders, body.qpos[:2], BOX_SLOTS, CYLINDER_SLOTS)
    model = with_window(robot, window)
    step_s = model.opt.timestep

    def physics_step(carry: tuple[Body, Work], _: None) -> tuple[tuple[Body, Work], None]:
        before, work = carry
        data = robot.data.replace(
            qpos=before.qpos, qvel=before.qvel, act=before.act, qacc_warmstart=before.warmstart, ctrl=control
        )
        data = mjx.step(model, data)
        push_n = data.qfrc_constraint[:2]
        force_n = jnp.sqrt(jnp.sum(push_n**2))
        power_w = jnp.sum(jnp.abs(data.qfrc_actuator * before.qvel))
        after = Body(data.qpos, data.qvel, data.act, data.qacc_warmstart)
        worked = Work(
            work.impulse_ns + force_n * step_s, work.push_ns + push_n * step_s, work.energy_j + power_w * step_s
        )
        return (after, worked), None

    nothing = Work(jnp.zeros(()), jnp.zeros(2), jnp.zeros(()))
    (after, work), _ = jax.lax.scan(physics_step, (body, nothing), None, length=robot.physics_steps)
    return Motion(after, work, distance_m(window, after.qpos[:2]) - robot.hull.radius_m)
