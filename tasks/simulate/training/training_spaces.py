"""What a trainer gives, sees and is paid: actions, observations and rewards.

An action does to the actuators from -1 to 1 over each control range, or is the control itself. Of an observation a
trainer sees some of the fields that controllers get, as float32, with bounds. A reward says what a control step was
worth: it is a function in JAX of one lane's step, such as ``progress``.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from specs.base import Fault
from specs.bundle_files import ColorCameraDeclaration
from specs.errors import DocumentError
from tasks.simulate.application.contract import TIMEOUT, Joints, Observation, Truth, Verdict
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import compile_robot
from tasks.simulate.sensors.sensor_table import Sensors


class ActionMap(NamedTuple):
    """How actions become controls.

    Actuators without a ``ctrlrange`` are no part of an action: they are given 0, as the courier's, which holds it from
    sliding sideways.

    Attributes:
        names: Of the actuators that an action drives, in its order.
        places: Where their controls are.
        low, high: Their control ranges.
        actuators: How many numbers a control has.
        normalized: Whether actions go from -1 to 1; else they are controls.
    """

    names: tuple[str, ...]
    places: Int[np.ndarray, "actions"]
    low: Float32[np.ndarray, "actions"]
    high: Float32[np.ndarray, "actions"]
    actuators: int
    normalized: bool

    @property
    def least(self) -> Float32[np.ndarray, "actions"]:
        """Returns the least action."""
        return np.full_like(self.low, -1.0) if self.normalized else self.low

    @property
    def most(self) -> Float32[np.ndarray, "actions"]:
        """Returns the largest action."""
        return np.full_like(self.high, 1.0) if self.normalized else self.high


def action_map(robot: Path, *, normalized: bool) -> ActionMap:
    """Returns how actions become controls of a robot.

    Args:
        robot: Its ``robot.xml``.
        normalized: Whether actions go from -1 to 1.

    Raises:
        DocumentError: No actuator has a ``ctrlrange``, so that there is nothing to draw actions from.
    """
    model = compile_robot(read_robot_mjcf(robot))
    limited = np.flatnonzero(model.actuator_ctrllimited)
    if not limited.size:
        allowed = "at least one actuator with a ctrlrange: actions are drawn from it"
        raise DocumentError.of("actuator", "no ctrlrange", allowed, source=f"{robot}")
    low, high = model.actuator_ctrlrange[limited].astype(np.float32).T
    names = tuple(model.actuator(int(each)).name or f"actuator {each}" for each in limited)
    return ActionMap(names, limited, np.ascontiguousarray(low), np.ascontiguousarray(high), model.nu, normalized)


def control_of(actions: ActionMap, action: Float[jax.Array, "actions"]) -> Float[jax.Array, "actuators"]:
    """Returns one lane's control.

    An action from -1 to 1 becomes ``middle + half * action``, clipped before; a control is clipped to its range.

    Args:
        actions: The robot's.
        action: One number for each actuator that has a control range.
    """
    held = jnp.clip(action, actions.least, actions.most)
    if actions.normalized:
        middle, half = (actions.high + actions.low) / 2, (actions.high - actions.low) / 2
        held = middle + half * held
    return jnp.zeros(actions.actuators, jnp.float32).at[actions.places].set(held)


# Where nature sets no bound: a yaw counts turns, and a robot that is pushed may move at any speed.
UNBOUNDED = 1e4
# Single precision has no more whole numbers one after the other.
_MOST_TICKS = 2.0**24
_JOINT_FIELDS = ("qpos", "qvel")


# The one field that the host draws, whose numbers are bytes.
COLOR = "color"


class FieldBounds(NamedTuple):
    """The bounds of an observation's field, in the field's shape and of its type."""

    low: Float32[np.ndarray, "..."] | UInt8[np.ndarray, "..."]
    high: Float32[np.ndarray, "..."] | UInt8[np.ndarray, "..."]


class EpisodeBounds(NamedTuple):
    """What bounds the observations of a pool's episodes.

    Attributes:
        duration_s: The longest episode's.
        goals: The most goals of an episode.
        reach_m: No goal, and no place within a world, has a larger coordinate.
    """

    duration_s: float
    goals: int
    reach_m: float


def default_fields(sensors: Sensors, camera: ColorCameraDeclaration | None) -> tuple[str, ...]:
    """Returns what a reactive controller needs: the scan, the pictures, the goal as the robot sees it, and contacts."""
    scan = ("ranges_m",) if sensors.lidar.rays else ()
    pictures = (*(("depth_m",) if sensors.depth_camera else ()), *((COLOR,) if camera else ()))
    return (*scan, *pictures, "goal_robot_m", *(("bumper",) if sensors.bumper.sectors else ()))


def field_bounds(
    fields: Sequence[str],
    sensors: Sensors,
    joints: Joints | None,
    episodes: EpisodeBounds,
    camera: ColorCameraDeclaration | None = None,
) -> dict[str, FieldBounds]:
    """Returns the bounds of the fields that a trainer wants, in its order.

    Args:
        fields: Names of an Observation's fields; ``joints`` stands for ``qpos`` and ``qvel``.
        sensors: The robot's.
        joints: Of a robot that is more than a planar base.
        episodes: The pool's.
        camera: The robot's, if it has one that sees colours.

    Raises:
        DocumentError: There is no such field, or the robot has none such, or one comes twice.
    """
    known = _all_bounds(sensors, joints, episodes)
    if camera:
        size = (*camera.shape, 3)
        known[COLOR] = FieldBounds(np.zeros(size, np.uint8), np.full(size, 255, np.uint8))
    wrong = [name for name in dict.fromkeys(fields) if name not in known]
    twice = sorted({name for name in fields if list(fields).count(name) > 1})
    allowed = f"fields of this robot's observation, each once: {', '.join(known)}"
    if wrong or twice or not fields:
        names = wrong or twice or [""]
        raise DocumentError(
            [Fault(path="observation", value=repr(name), allowed=allowed) for name in names], "simyard.gym"
        )
    return {name: known[name] for name in fields}


def observed_fields(bounds: Mapping[str, FieldBounds], observed: Observation) -> dict[str, Float[jax.Array, "..."]]:
    """Returns what a trainer sees of one lane's observation, within its bounds.

    Args:
        bounds: Of each field that it wants.
        observed: What a controller would get.
    """
    values = observed._asdict() | (observed.joints._asdict() if observed.joints is not None else {})
    return {
        name: jnp.clip(jnp.asarray(values[name], jnp.float32), each.low, each.high) for name, each in bounds.items()
    }


def _all_bounds(sensors: Sensors, joints: Joints | None, episodes: EpisodeBounds) -> dict[str, FieldBounds]:
    rays, sectors, reach = sensors.lidar.rays, sensors.bumper.sectors, episodes.reach_m
    known = {
        "ranges_m": _between(0.0, sensors.lidar.range_m, rays),
        "goal_robot_m": _between(-4.0 * reach, 4.0 * reach, 2),
        "goal_m": _between(-reach, reach, 2),
        "goal_index": _between(0.0, float(max(episodes.goals - 1, 1))),
        "pose": _between(-UNBOUNDED, UNBOUNDED, 3),
        "velocity": _between(-UNBOUNDED, UNBOUNDED, 3),
        "bumper": _between(0.0, 1.0, sectors),
        "time_s": _between(0.0, episodes.duration_s),
    }
    if camera := sensors.depth_camera:
        known["depth_m"] = _between(0.0, camera.range_m, *camera.shape)
    if finders := sensors.range_finders:
        known["finder_m"] = _between(0.0, finders.range_m, finders.finders)
    if cliffs := sensors.cliff_sensors:
        known["cliff_m"] = _between(0.0, cliffs.range_m, cliffs.sensors)
    if sensors.wheel_encoders:
        known["ticks"] = _between(-_MOST_TICKS, _MOST_TICKS, 2)
    triples = {"turn_rad_s": sensors.imu, "force_m_s2": sensors.imu, "field_ut": sensors.compass, "gps_m": sensors.gps}
    for name in (name for name, sensor in triples.items() if sensor):
        known[name] = _between(-UNBOUNDED, UNBOUNDED, 3)
    for name in _JOINT_FIELDS if joints is not None else ():
        known[name] = _between(-UNBOUNDED, UNBOUNDED, *getattr(joints, name).shape)
    return {name: bounds for name, bounds in known.items() if bounds.low.size}


def _between(low: float, high: float, *shape: int) -> FieldBounds:
    return FieldBounds(np.full(shape, low, np.float32), np.full(shape, high, np.float32))


# What a goal is worth, and what the end of an episode costs that the robot brought about: in metres of way.
ARRIVAL_M, FAULT_M = 5.0, 5.0
# What a newton second of contact costs, and a control step: a robot that stands still shall lose.
CONTACT_M_PER_NS, STEP_M = 1.0, 0.005
# One step's contact costs no more than this many newton seconds: what blows up shall not blow up a network.
_MOST_NS = 1.0


class Transition(NamedTuple):
    """One control step of one lane, for its reward.

    Attributes:
        before, after: What the robot senses at the step's beginning and at its end.
        control: What drove it.
        truth: What really happened.
        verdict: What the scenario says of it, or the engine: time is up, the robot crashed.
        way_before_m, way_after_m: The way to the goal that it had at the step's beginning, from where it was then, and
            from where it is now.
    """

    before: Observation
    after: Observation
    control: Float[jax.Array, "actuators"]
    truth: Truth
    verdict: Verdict
    way_before_m: Float[jax.Array, ""]
    way_after_m: Float[jax.Array, ""]


Reward = Callable[[Transition], Float[jax.Array, ""]]


def progress(step: Transition) -> Float[jax.Array, ""]:
    """Returns the metres of way that a step took off, with what contacts, arrivals and bad ends are worth in metres.

    It is the way before minus the way after, minus ``STEP_M``, minus ``CONTACT_M_PER_NS`` for each newton second of
    contact, plus ``ARRIVAL_M`` for each goal that was reached, minus ``FAULT_M`` where the episode ended with neither
    success nor the end of its time. The way is a potential, so that progress alone changes no best policy (A. Y. Ng,
    D. Harada, S. Russell, Policy Invariance under Reward Transformations, 1999).

    Args:
        step: What happened.
    """
    reached = step.verdict.goal_index - step.before.goal_index
    fault = step.verdict.done & (step.verdict.reason != 0) & (step.verdict.reason != TIMEOUT)
    contact_ns = jnp.minimum(step.truth.impulse_ns, _MOST_NS)
    gained_m = step.way_before_m - step.way_after_m - STEP_M - CONTACT_M_PER_NS * contact_ns
    return gained_m + ARRIVAL_M * reached.astype(jnp.float32) - FAULT_M * fault.astype(jnp.float32)
