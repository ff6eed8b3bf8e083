"""The contract between applications and engines: all tuples that they hand each other (docs/guide/applications.md).

Bundles import nothing from here when they run: what they receive are these tuples, and what they return needs only
the attributes named here. The last ones are between engines and lanes alone: a robot's mechanical state, and what the
physics of a control step did to it.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, UInt8

from specs.data.outcomes import REASON_CODES, OutcomeReason
from specs.data.world import World

# Whatever a bundle keeps from one control step to the next: a pytree of arrays.
State = Any
Environment = Mapping[str, "str | Float[jax.Array, '']"]


class FloorMap(NamedTuple):
    """What is free for the robot, on a square grid; ``clearance_m[row, column]`` is at row y, column x.

    Its size follows from the world alone.

    Attributes:
        clearance_m: Distance from each cell's centre to the nearest solid, 0 inside one and outside the apartment.
        origin_m: Centre (x, y) of the cell (0, 0).
        cell_m: Side of a cell.
        bounds_m: The apartment's outer faces: (x min, y min, x max, y max).
    """

    clearance_m: Float[jax.Array, "rows columns"]
    origin_m: Float[jax.Array, "2"]
    cell_m: Float[jax.Array, ""]
    bounds_m: Float[jax.Array, "4"]


class HostMap(NamedTuple):
    """A FloorMap before it goes to a device, for what is done once an episode; fields as there."""

    clearance_m: Float32[np.ndarray, "rows columns"]
    origin_m: Float32[np.ndarray, "2"]
    cell_m: Float32[np.ndarray, ""]
    bounds_m: Float32[np.ndarray, "4"]


class Joints(NamedTuple):
    """All coordinates and speeds of a robot that is more than a planar base, as MuJoCo orders them (qpos, qvel)."""

    qpos: Float[jax.Array, "coordinates"]
    qvel: Float[jax.Array, "speeds"]


class FreeJoints(Joints):
    """The same of a robot whose base has a free joint, whose coordinates and speeds come first."""

    __slots__ = ()


def joints_kind(*, free: bool) -> type[Joints]:
    """Returns what holds the joints of a robot whose base has a free joint, or has not."""
    return FreeJoints if free else Joints


class Observation(NamedTuple):
    """What the robot senses at a control step.

    Attributes:
        time_s: Since the episode began.
        pose: Where the robot is: (x m, y m, yaw rad); where it believes to be when it has odometry.
        velocity: How it moves: (m/s, m/s, rad/s) along the world's axes, as its yaw has them.
        ranges_m: Lidar, counter-clockwise; the lidar's range where nothing is seen.
        goal_index: Which goal it should go to now.
        goal_m: Where that is: (x, y).
        goal_robot_m: The same seen from ``pose``: (ahead, to the left).
        bumper: Which sectors were touched during the last control step, counter-clockwise from straight ahead.
        joints: All that moves, of a robot with more than a planar base; None for one without.
        depth_m: The depth camera's last picture that is there, from its upper left corner, or that of each camera of a
            list; None for a robot without.
        turn_rad_s, force_m_s2: What an IMU reads, along its own axes: turn rates, and specific force, which is 9.81
            upwards at rest; None for a robot without.
        finder_m: How near the nearest thing is for each range finder; None for a robot without.
        ticks: Counts of the left wheel and of the right one since the episode began; None for a robot without.
        field_ut: The earth's magnetic field along the robot's axes, microtesla; None for a robot without a compass.
        cliff_m: How far below each cliff sensor the nearest thing is; None for a robot without.
        gps_m: Where the antenna of a receiver of satellites is: to the east and to the north of the world's origin, and
            above it; None for a robot without.
        color: What a colour camera sees, for controllers that run on the host; None for a robot without.
    """

    time_s: Float[jax.Array, ""]
    pose: Float[jax.Array, "3"]
    velocity: Float[jax.Array, "3"]
    ranges_m: Float[jax.Array, "rays"]
    goal_index: Int[jax.Array, ""]
    goal_m: Float[jax.Array, "2"]
    goal_robot_m: Float[jax.Array, "2"]
    bumper: Bool[jax.Array, "sectors"]
    joints: Joints | None = None
    depth_m: Float[jax.Array, "*cameras height width"] | None = None
    turn_rad_s: Float[jax.Array, "3"] | None = None
    force_m_s2: Float[jax.Array, "3"] | None = None
    finder_m: Float[jax.Array, "finders"] | None = None
    ticks: Int[jax.Array, "2"] | None = None
    field_ut: Float[jax.Array, "3"] | None = None
    cliff_m: Float[jax.Array, "cliffs"] | None = None
    gps_m: Float[jax.Array, "3"] | None = None
    color: UInt8[np.ndarray, "*cameras height width 3"] | None = None


class Controller(Protocol):
    """What ``controller(environment)`` in a robot application returns; pure JAX, for one robot.

    Beside these functions it may have sensors, each by its name in ``tasks.simulate.sensors.sensor_table``.
    """

    def init(self, floor: FloorMap, goals_m: Float[jax.Array, "goals 2"]) -> State:
        """Returns what the controller keeps, before the first step; the place to plan."""
        ...

    def step(self, state: State, observation: Observation) -> tuple[State, Float[jax.Array, "actuators"]]:
        """Returns what it keeps, in the same form, and one number for each of the robot's actuators."""
        ...


class Truth(NamedTuple):
    """What really happened in a control step, for the scenario to judge.

    Attributes:
        time_s: At the step's end.
        pose: At the step's end: (x m, y m, yaw rad).
        velocity: At the step's end, along the world's axes.
        clearance_m: From the hull to the nearest solid at its heights, seen from above; below 0 when pressed into it.
        impulse_ns: What contacts pushed the robot with during the step, newton seconds in the plane.
        inside: Whether the robot is within the apartment's outer faces.
    """

    time_s: Float[jax.Array, ""]
    pose: Float[jax.Array, "3"]
    velocity: Float[jax.Array, "3"]
    clearance_m: Float[jax.Array, ""]
    impulse_ns: Float[jax.Array, ""]
    inside: Bool[jax.Array, ""]


class Verdict(NamedTuple):
    """What the scenario says after a control step.

    Attributes:
        goal_index: The goal to go to now; how many were reached.
        done: Whether the episode is over.
        reason: Index in ``REASONS``; 0 with ``done`` means that the robot did its task.
    """

    goal_index: Int[jax.Array, ""]
    done: Bool[jax.Array, ""]
    reason: Int[jax.Array, ""]


class Placement(NamedTuple):
    """How an episode begins.

    Attributes:
        start: (x m, y m, yaw rad).
        goals_m: Which places the robot shall visit, in order.
        given: Whatever arrays the scenario's ``init`` needs of the world.
        arrived_m: How near to a goal is there, the scenario's ``arrived_m``; None where goals are no destinations.
    """

    start: Float64[np.ndarray, "3"]
    goals_m: Float64[np.ndarray, "goals 2"]
    given: tuple[np.ndarray, ...] = ()
    arrived_m: float | None = 0.0


class Scenario(Protocol):
    """What ``scenario(environment)`` in a simulation application returns.

    ``place`` runs once an episode in NumPy; ``init`` and ``step`` are pure JAX, and get the episode's own goals and
    arrays, whatever other episodes have. In training alone, where all episodes share a program, ``init`` gets the last
    goal repeated until all have as many: ``given`` can hold the number. It may also have ``arrived_m`` (how near to a
    goal is there; 0 without it, None for goals that are no destinations) and ``metrics(state)``, a dictionary of
    scalars. Its ``place`` may have an argument ``shares`` (`specs.data.physics.GoalShares`), which is given where
    variables of an episode say by which numbers its goals are drawn.
    """

    def place(self, world: World, floor: HostMap, hull_radius_m: float, rng: np.random.Generator) -> Placement:
        """Returns the start, and at least one goal.

        Args:
            world: Where the episode takes place.
            floor: Its clearance map.
            hull_radius_m: The robot's.
            rng: The episode's own, from its seed.
        """
        ...

    def init(self, start: Float[jax.Array, "3"], goals_m: Float[jax.Array, "goals 2"], *given: jax.Array) -> State:
        """Returns what the scenario keeps, before the first step; it gets what its ``place`` gave."""
        ...

    def step(self, state: State, truth: Truth) -> tuple[State, Verdict]:
        """Returns what it keeps, in the same form, and its verdict on the control step."""
        ...


REASONS: tuple[OutcomeReason, ...] = REASON_CODES
COLLISION, PERSON, ROBOT = REASONS.index("collision"), REASONS.index("person"), REASONS.index("robot")
STUCK, DEADLOCK = REASONS.index("stuck"), REASONS.index("deadlock")
TIMEOUT, CRASH = REASONS.index("timeout"), REASONS.index("crash")


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


class PeopleWork(NamedTuple):
    """What a control step's physics did with people.

    Attributes:
        impulse_ns: How much they and the robot pushed each other.
        distance_m: From its hull to the nearest of them at the step's end, seen from above; below 0 where they overlap.
    """

    impulse_ns: Float[jax.Array, ""]
    distance_m: Float[jax.Array, ""]


class Motion(NamedTuple):
    """What an engine makes of a control step.

    Attributes:
        body: The robot at the step's end.
        work: What solids and people did to it.
        clearance_m: From its hull to the nearest solid then, seen from above; below 0 where they overlap.
        people: What people did; None where there are none.
        robots_ns: How much other robots and it pushed each other; None where it is alone.
    """

    body: Body
    work: Work
    clearance_m: Float[jax.Array, ""]
    people: PeopleWork | None = None
    robots_ns: Float[jax.Array, ""] | None = None
