"""What a lane's robot senses at a control step, and what its controller makes of it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from specs.data.episode import CONTROL_S
from tasks.simulate.application.calls import Applications
from tasks.simulate.application.contract import Observation
from tasks.simulate.application.sensors import is_set, ray_angles
from tasks.simulate.lane.lane_state import Decision, LaneInputs, LaneState, Motion, Sensed
from tasks.simulate.lane.noise import drifted, noisy_ranges
from tasks.simulate.surroundings.lidar import scan_ranges


def decide(applications: Applications, inputs: LaneInputs, state: LaneState) -> Decision:
    """Returns what the controller keeps, its control for the step to come, and the scan that it saw."""
    observed = observe(applications, inputs, state)
    kept, control = applications.controller(inputs.numbers).step(state.controller, observed)
    return Decision(kept, control, observed.ranges_m)


def observe(applications: Applications, inputs: LaneInputs, state: LaneState) -> Observation:
    """Returns what the robot senses before a control step."""
    pose, velocity = state.body.qpos, state.body.qvel
    if state.sensed.pose is not None:
        velocity = _turned(velocity, state.sensed.pose[2] - pose[2])
        pose = state.sensed.pose
    goal = jnp.clip(state.goal_index, 0, inputs.goals_m.shape[0] - 1)
    return Observation(
        time_s=state.step * CONTROL_S,
        pose=pose,
        velocity=velocity,
        ranges_m=_scan(applications, inputs, state),
        goal_index=goal,
        goal_m=inputs.goals_m[goal],
        goal_robot_m=_turned(inputs.goals_m[goal] - pose[:2], -pose[2]),
        bumper=state.sensed.bumper,
        joints=state.body.joints,
    )


def feel(applications: Applications, inputs: LaneInputs, state: LaneState, motion: Motion) -> Sensed:
    """Returns what odometry and bumper make of a control step that an engine drove."""
    before, after, pose = state.body.qpos, motion.body.qpos, state.sensed.pose
    odometry = applications.lane_sensors(inputs.numbers).odometry
    if odometry is not None and pose is not None:
        pose = drifted(pose, before, after, odometry, seed=inputs.seed, step=state.step)
    return Sensed(pose, _touched(motion.work.push_ns, after[2], applications.sensors.bumper.sectors))


def _scan(applications: Applications, inputs: LaneInputs, state: LaneState) -> Float[jax.Array, "rays"]:
    shared, own = applications.lidar, applications.lane_sensors(inputs.numbers).lidar
    if shared.rays == 0:
        return jnp.zeros(0)
    pose = state.body.qpos
    mount = (own.x_m, own.y_m, own.yaw_rad)
    if any(map(is_set, mount)):
        offset = jnp.stack([jnp.asarray(value, pose.dtype) for value in mount])
        pose = pose + _turned(offset, pose[2])
    ranges = scan_ranges(inputs.seen, pose, ray_angles(shared), shared.range_m)
    return noisy_ranges(ranges, own, inputs.seed, state.step)


def _turned(vector: Float[jax.Array, "axes"], yaw_rad: Float[jax.Array, ""]) -> Float[jax.Array, "axes"]:
    """Returns a vector with its first two parts turned counter-clockwise."""
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    turned = jnp.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
    return jnp.concatenate([turned, vector[2:]])


def _touched(push_ns: Float[jax.Array, "2"], yaw_rad: Float[jax.Array, ""], sectors: int) -> Bool[jax.Array, "sectors"]:
    """Returns which sector of the hull the robot was pushed on: the one opposite to where it was pushed to."""
    bearing = jnp.arctan2(-push_ns[1], -push_ns[0]) - yaw_rad
    pressed = jnp.round(bearing * (max(sectors, 1) / (2 * np.pi))) % max(sectors, 1)
    return (jnp.arange(sectors) == pressed) & jnp.any(push_ns != 0.0)
