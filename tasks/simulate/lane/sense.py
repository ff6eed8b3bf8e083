"""The first half of a control step: a lane's robot senses, and its controller decides."""

import jax.numpy as jnp

from specs.data.episode import CONTROL_S
from tasks.simulate.application.contract import Observation
from tasks.simulate.application.motion import Motion
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import Decision, LaneInputs, LaneState
from tasks.simulate.sensor.sensor import Drive, Fields, Memory, Situation, rotate
from tasks.simulate.sensor.sensors import feel_all, observe_all


def decide(applications: Applications, inputs: LaneInputs, state: LaneState) -> Decision:
    """Returns what the controller keeps, its control for the step to come, and the scan that it saw."""
    observed = observe(applications, inputs, state)
    kept, control = applications.controller(inputs.numbers).step(state.controller, observed)
    return Decision(kept, control, observed.ranges_m)


def observe(applications: Applications, inputs: LaneInputs, state: LaneState) -> Observation:
    """Returns what the robot senses before a control step; without sensors of its pose it knows the true one."""
    own, body = applications.lane_sensors(inputs.numbers), state.body
    situation = Situation(body, inputs.seen, inputs.seed, state.step)
    sensed: Fields = {"pose": body.qpos, "velocity": body.qvel}
    sensed |= observe_all(applications.sensors, own, state.sensed, situation)
    goal = jnp.clip(state.goal_index, 0, inputs.goals_m.shape[0] - 1)
    pose = sensed["pose"]
    return Observation(
        time_s=state.step * CONTROL_S,
        goal_index=goal,
        goal_m=inputs.goals_m[goal],
        goal_robot_m=rotate(inputs.goals_m[goal] - pose[:2], -pose[2]),
        joints=body.joints,
        **sensed,
    )


def feel(applications: Applications, inputs: LaneInputs, state: LaneState, motion: Motion) -> dict[str, Memory]:
    """Returns what the sensors remember after a control step that an engine drove, by name.

    Args:
        applications: With the sensors.
        inputs: The lane's.
        state: Before the step.
        motion: What the engine made of it.
    """
    own = applications.lane_sensors(inputs.numbers)
    return feel_all(applications.sensors, own, state.sensed, Drive(state.body, motion, inputs.seed, state.step))
