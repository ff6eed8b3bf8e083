"""The mjx engine: any robot that MJX can step, in a window of the obstacles nearest to it."""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tasks.simulate.application.contract import Joints
from tasks.simulate.application.coordinates import coordinates_at, pose_of, velocity_of
from tasks.simulate.application.motion import Body, Motion, Work
from tasks.simulate.engine.mjx.mjx_import import mjx
from tasks.simulate.engine.mjx.model import BOX_SLOTS, CYLINDER_SLOTS, RobotModel, load_robot
from tasks.simulate.engine.mjx.window import nearest_obstacles, with_window
from tasks.simulate.lane.lane_state import LaneInputs
from tasks.simulate.lane.step import Mechanics
from tasks.simulate.surroundings.hull_distance import hull_distance_m


def mjx_mechanics(path: Path) -> Mechanics:
    """Returns the robot of a ``robot.xml`` on this engine.

    Raises:
        RobotRefused: MJX cannot step it; says which element, and the remedy.
    """
    robot = load_robot(path)
    return Mechanics(
        engine="mjx",
        hull=robot.hull,
        actuators=robot.actuators,
        first_body=functools.partial(first_body, robot),
        drive=functools.partial(drive, robot),
    )


def first_body(robot: RobotModel, start: Float[jax.Array, "3"]) -> Body:
    """Returns a robot at rest at its start."""
    joints = Joints(coordinates_at(robot.base, jnp.asarray(robot.rest), start, jnp), jnp.zeros(robot.host.nv))
    return _body(robot, joints, jnp.asarray(robot.rest_act), jnp.zeros(robot.host.nv))


def drive(robot: RobotModel, inputs: LaneInputs, body: Body, control: Float[jax.Array, "actuators"]) -> Motion:
    """Returns what a control step's physics does to a robot.

    Args:
        robot: The robot.
        inputs: The lane's, with the obstacles.
        body: The robot at the step's beginning.
        control: One number for each actuator.
    """
    window = nearest_obstacles(inputs.boxes, inputs.cylinders, body.qpos[:2], BOX_SLOTS, CYLINDER_SLOTS)
    model = with_window(robot, window)
    step_s = model.opt.timestep

    def physics_step(carry: tuple[Body, Work], _: None) -> tuple[tuple[Body, Work], None]:
        before, work = carry
        joints = before.joints or Joints(before.qpos, before.qvel)
        data = robot.data.replace(
            qpos=joints.qpos, qvel=joints.qvel, act=before.act, qacc_warmstart=before.warmstart, ctrl=control
        )
        data = mjx.step(model, data)
        push_n = _push_n(robot, data)
        force_n = jnp.sqrt(jnp.sum(push_n**2))
        after = _body(robot, Joints(data.qpos, data.qvel), data.act, data.qacc_warmstart)
        worked = Work(
            work.impulse_ns + force_n * step_s,
            work.push_ns + push_n * step_s,
            work.energy_j + _power_w(data) * step_s,
        )
        return (after, worked), None

    nothing = Work(jnp.zeros(()), jnp.zeros(2), jnp.zeros(()))
    (after, work), _ = jax.lax.scan(physics_step, (body, nothing), None, length=robot.physics_steps)
    return Motion(after, work, hull_distance_m(robot.parts, window.boxes, window.cylinders, after.qpos))


def _body(robot: RobotModel, joints: Joints, act: jax.Array, warmstart: jax.Array) -> Body:
    pose, velocity = pose_of(robot.base, joints.qpos, jnp), velocity_of(robot.base, *joints, jnp)
    return Body(pose, velocity, act, warmstart, joints if robot.base.articulated else None)


def _power_w(data: mjx.Data) -> Float[jax.Array, ""]:
    """Returns what the actuators spend, each by itself: sums over coordinates would depend on where the axes point."""
    speeds = data._impl.actuator_velocity  # noqa: SLF001 - MJX has no public way to it
    return jnp.sum(jnp.abs(data.actuator_force * speeds))


def _push_n(robot: RobotModel, data: mjx.Data) -> Float[jax.Array, "2"]:
    """Returns the force of obstacles on the robot in the plane; floor, limits and dry friction do not count.

    What acts on the base's first two coordinates is the net force on the whole robot.
    """
    if robot.only_obstacles_hold:
        return data.qfrc_constraint[:2]
    inner = data._impl  # noqa: SLF001 - MJX has no public way to a contact's force
    slots = np.concatenate([robot.box_slots, robot.cylinder_slots])
    contact = inner.contact
    by_obstacle = jnp.isin(contact.geom, slots).any(axis=1)
    first, count = contact.efc_address, np.where(contact.dim == 1, 1, 2 * (contact.dim - 1))
    if robot.host.opt.cone:
        count = contact.dim
    rows = np.concatenate([first[k] + np.arange(count[k]) for k in range(len(first))])
    owners = np.repeat(np.arange(len(first)), count)
    forces = jnp.where(by_obstacle[owners], inner.efc_force[rows], 0.0)
    return forces @ inner.efc_J[rows, :2]
