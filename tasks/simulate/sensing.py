"""What a lane's robot senses at a control step, and what its controller makes of it."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.applications import Applications
from tasks.simulate.contract import Observation, State
from tasks.simulate.lane_state import LaneInputs, LaneState
from tasks.simulate.lidar import scan_ranges
from tasks.simulate.robot import CONTROL_S


def decide(
    applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[State, Float[jax.Array, "actuators"]]:
    """Returns what the controller keeps, and its control for the step to come."""
    lidar, pose = applications.lidar, state.body.qpos
    ranges = scan_ranges(inputs.seen_boxes, inputs.seen_cylinders, pose, lidar.rays, lidar.range_m)
    goal = jnp.clip(state.goal_index, 0, inputs.goals_m.shape[0] - 1)
    observation = Observation(
        time_s=state.step * CONTROL_S,
        pose=pose,
        velocity=state.body.qvel,
        ranges_m=ranges,
        goal_index=goal,
        goal_m=inputs.goals_m[goal],
    )
    return applications.controller(inputs.numbers).step(state.controller, observation)
