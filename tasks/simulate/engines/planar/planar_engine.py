"""The planar engine: mobile bases among upright boxes, cylinders and prisms, stepped as C MuJoCo would, in plain JAX.

It runs the robots that ``planar_robot`` accepts. A robot in the plane has three degrees of freedom and its
contacts are those of discs, so a step is a few hundred operations on scalars; mapped over lanes, each is one vector
operation. Formulas of the actuators: MuJoCo documentation, chapter Computation, "Actuation model" and, for the slopes,
"Numerical integration".
"""

import functools
import math
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from specs.data.people import PERSON_RADIUS_M
from tasks.simulate.application.contract import Body, Motion, PeopleWork, Work
from tasks.simulate.engines.planar.disc_contact import (
    Bearing,
    Contact,
    Flag,
    Obstacle,
    bearing,
    contact,
    distance_m,
    is_zero,
    touch,
    window,
    with_boxes,
    with_people,
    with_robots,
)
from tasks.simulate.engines.planar.near_obstacles import (
    Neighbours,
    among_fewest,
    few_counts,
    neighbours,
    obstacles_needed,
)
from tasks.simulate.engines.planar.newton_solver import contact_force, minimizer
from tasks.simulate.engines.planar.planar_algebra import (
    Moving,
    Planar,
    Scalar,
    Symmetric,
    dot,
    plus,
    plus_square,
    solved,
    times,
)
from tasks.simulate.engines.planar.planar_robot import Disc, Motor, PlanarRobot, planar_robot, varied_robot
from tasks.simulate.geometry.hull_distance import LaneObstacles
from tasks.simulate.geometry.obstacles import PARKING_M
from tasks.simulate.lane.control_step import LaneInputs, Mechanics
from tasks.simulate.lane.shared_world import Others, RobotsInputs


class Push(NamedTuple):
    """What the actuators do in a physics step.

    Attributes:
        force: Along the joints.
        slopes: Each motor's moment and the change of its force with its speed; none unless the integrator asks.
        activations: After the step.
        power_w: What the motors spend, each by itself: a sum over axes would depend on where the axes point.
    """

    force: Planar
    slopes: list[tuple[Planar, Scalar]]
    activations: list[Scalar]
    power_w: Scalar


def push(robot: PlanarRobot, controls: list[Scalar], activations: list[Scalar], moving: Moving) -> Push:
    """Returns what the actuators do to a robot.

    Args:
        robot: With its motors.
        controls: One for each motor.
        activations: Of the motors that have one.
        moving: How the robot stands and moves.
    """
    after = list(activations)
    power_w = jnp.zeros_like(moving.cos)
    total = Planar(*[jnp.zeros_like(moving.cos)] * 3)
    slopes: list[tuple[Planar, Scalar]] = []
    for motor, control in zip(robot.motors, controls, strict=True):
        drive = _limited(control, motor.control_range)
        if motor.activation is not None:
            before = activations[motor.activation]
            after[motor.activation] = _next_activation(motor, drive, before, robot.step_s)
            drive = after[motor.activation] if motor.early else before
        moment = _moment(motor, moving)
        length, speed = dot(_constant(motor.length, moving), moving.place), dot(moment, moving.rate)
        force = _affine(motor.gain, length, speed) * drive + _affine(motor.bias, length, speed)
        if robot.implicit_motors:
            slopes.append((moment, _slope(motor, force, drive)))
        force = _limited(force, motor.force_range)
        power_w = power_w + jnp.abs(force * speed)
        total = plus(total, moment, force)
    limited = Planar(*[_limited(each, limits) for each, limits in zip(total, robot.joint_force_ranges, strict=True)])
    return Push(limited, slopes, after, power_w)


def _moment(motor: Motor, moving: Moving) -> Planar:
    """Returns the forces along the joints that a motor's force of 1 makes."""
    unturned = _constant(motor.moment, moving)
    return Planar(*moving.turned(unturned.x, unturned.y), unturned.yaw) if motor.turns else unturned


def _constant(vector: tuple[float, float, float], moving: Moving) -> Planar:
    return Planar(*(jnp.full_like(moving.cos, each) for each in vector))


def _next_activation(motor: Motor, drive: Scalar, before: Scalar, step_s: float) -> Scalar:
    """Returns the activation of an integrator, or of a filter, a step later."""
    if motor.time_constant_s is None:
        after = before + step_s * drive
    else:
        lag_s = max(motor.time_constant_s, 1e-15)
        share = -math.expm1(-step_s / lag_s) if motor.exact_filter else step_s / lag_s
        after = before + share * (drive - before)
    return _limited(after, motor.activation_range)


def _slope(motor: Motor, force: Scalar, drive: Scalar) -> Scalar:
    """Returns how a motor's force changes with its speed; not at all where its range holds it."""
    slope = motor.gain[2] * drive + motor.bias[2]
    if motor.force_range is None:
        return slope
    low, high = motor.force_range
    return jnp.where((force <= low) | (force >= high), 0.0, slope)


def _affine(coefficients: tuple[float, float, float], length: Scalar, speed: Scalar) -> Scalar:
    constant, per_length, per_speed = coefficients
    total = jnp.full_like(speed, constant)
    total = total if is_zero(per_length) else total + per_length * length
    return total if is_zero(per_speed) else total + per_speed * speed


def _limited(value: Scalar, limits: tuple[float, float] | None) -> Scalar:
    return value if limits is None else jnp.clip(value, *limits)


# Obstacles that a robot may touch in one control step. They are those nearest to its axis: around it three were always
# enough, but an arm's length from it six (heavy contact in dense clutter, against C among all obstacles).
_AROUND_ONE_DISC = 6
_AROUND_MORE = 8
# For what single precision rounds of distances, and of coordinates.
_LEAST_M, _OF_COORDINATES = 1e-3, 4e-6


class _Surroundings(NamedTuple):
    """What does not change during a control step: where it began, the obstacles, and how each disc lies to each.

    Attributes:
        free_m: How far the robot can go before it may touch each obstacle.
        factors: Of mass, friction and motor strength; None in a program without.
    """

    origin: Planar
    obstacles: list[Obstacle]
    bearings: list[list[Bearing]]
    free_m: list[Scalar]
    controls: list[Scalar]
    factors: Float[jax.Array, "3"] | None = None


class _Robot(NamedTuple):
    """The robot's state; its place is relative to where the control step began, so that small steps count exactly.

    Where it heads is kept with it: it would be computed again in each of the six operations that the compiler makes of
    those that read it.
    """

    moved: Planar
    cos: Scalar
    sin: Scalar
    rate: Planar
    activations: list[Scalar]
    acceleration: Planar


class _Instant(NamedTuple):
    """A robot in a physics step, before obstacles hold it.

    Attributes:
        moved: Since the control step began.
        acting: The forces besides constraints.
        before: The acceleration of the physics step before.
        factors: Of mass, friction and motor strength; None in a program without.
    """

    moved: Planar
    moving: Moving
    acting: Planar
    before: Planar
    factors: Float[jax.Array, "3"] | None = None


_Push = tuple[Scalar, Scalar]


class _Spent(NamedTuple):
    """What is summed up over a control step; fields as in Work."""

    impulse_ns: Scalar
    push_x_ns: Scalar
    push_y_ns: Scalar
    energy_j: Scalar
    people_ns: Scalar
    robots_ns: Scalar | None = None


def planar_mechanics(path: Path) -> Mechanics:
    """Returns the robot of a ``robot.xml`` on this engine.

    Raises:
        RobotRefused: The engine cannot represent it; names every culprit, and the remedy.
    """
    robot = planar_robot(path)
    return Mechanics(
        engine="planar",
        hull=robot.hull,
        actuators=robot.actuators,
        rest_control=np.array(robot.rest_control, np.float32),
        first_body=functools.partial(first_body, robot),
        drive=functools.partial(drive, robot),
        near=functools.partial(near, robot),
    )


def first_body(robot: PlanarRobot, start: Float[jax.Array, "3"]) -> Body:
    """Returns a robot at rest at its start."""
    still = jnp.zeros_like(start)
    return Body(start, still, jnp.asarray(robot.rest_activations, start.dtype), still)


def near(robot: PlanarRobot, inputs: LaneInputs, body: Body) -> Neighbours:
    """Returns the obstacles that the robot's window can hold while it is about where it stands."""
    return neighbours(inputs.obstacles, body.qpos[:2], _window_size(robot))


def drive(robot: PlanarRobot, inputs: LaneInputs, body: Body, control: Float[jax.Array, "actuators"]) -> Motion:
    """Returns what a control step's physics does to a robot.

    Args:
        robot: The robot.
        inputs: The lane's, with the obstacles.
        body: The robot at the step's beginning.
        control: One number for each actuator.
    """
    own, people_m = inputs.physics, inputs.standing_m
    robots = None if inputs.robots is None or inputs.others is None else (inputs.robots, inputs.others)
    return drive_among(
        robot,
        inputs.obstacles,
        body,
        control,
        near=inputs.near,
        people_m=people_m,
        factors=own,
        robots=robots,
        boxes=inputs.put,
    )


def drive_among(
    robot: PlanarRobot,
    given: LaneObstacles,
    body: Body,
    control: Float[jax.Array, "actuators"],
    *,
    near: Neighbours | None = None,
    people_m: Float[jax.Array, "people 2"] | None = None,
    factors: Float[jax.Array, "3"] | None = None,
    robots: tuple[RobotsInputs, Others] | None = None,
    boxes: Float[jax.Array, "boxes 8"] | None = None,
) -> Motion:
    """Returns what a control step's physics does to a robot among obstacles.

    Args:
        robot: The robot.
        given: The obstacles in the hull's band of heights.
        body: The robot at the step's beginning.
        control: One number for each actuator.
        near: Those of the obstacles that were picked out before.
        people_m: Where people stand meanwhile (x, y); None without any.
        factors: Of mass, friction and motor strength; None in a program without.
        robots: What other robots are like, and how they are; None for a robot alone.
        boxes: What was put there, as the obstacles' boxes; None for nothing.
    """
    origin = Planar(*body.qpos)
    solids = window(given, body.qpos[:2], _window_size(robot), near)
    if boxes is not None:
        solids = with_boxes(solids, boxes, body.qpos[:2])
    obstacles = solids if people_m is None else with_people(solids, people_m, body.qpos[:2])
    if robots is not None:
        obstacles = with_robots(obstacles, robots[0], robots[1].place_m, body.qpos[:2])
    bearings = [[bearing(disc, obstacle) for obstacle in obstacles] for disc in robot.discs]
    nil = jnp.zeros_like(origin.x)
    around = _Surroundings(origin, obstacles, bearings, _free_m(robot, obstacles), list(control), factors)
    begin = _Robot(
        Planar(nil, nil, nil),
        jnp.cos(origin.yaw),
        jnp.sin(origin.yaw),
        Planar(*body.qvel),
        list(body.act),
        Planar(*body.warmstart),
    )

    def physics_step(carry: tuple[_Robot, _Spent], _: None) -> tuple[tuple[_Robot, _Spent], None]:
        return _physics_step(robot, around, *carry), None

    nothing = _Spent(nil, nil, nil, nil, nil, None if robots is None else nil)
    (end, spent), _ = jax.lax.scan(physics_step, (begin, nothing), None, length=robot.physics_steps)
    place = jnp.stack([start + moved for start, moved in zip(origin, end.moved, strict=True)])
    activations = jnp.stack(end.activations) if end.activations else body.act
    after = Body(place, jnp.stack(end.rate), activations, jnp.stack(end.acceleration))
    work = Work(spent.impulse_ns, jnp.stack([spent.push_x_ns, spent.push_y_ns]), spent.energy_j)
    clear_m = _clearance_m(robot, around._replace(obstacles=solids), end)
    if people_m is None:
        return Motion(after, work, clear_m, robots_ns=spent.robots_ns)
    people = PeopleWork(spent.people_ns, _to_people_m(robot, around, end, people_m))
    return Motion(after, work, clear_m, people, spent.robots_ns)


def _to_people_m(
    robot: PlanarRobot, around: _Surroundings, end: _Robot, people_m: Float[jax.Array, "people 2"]
) -> Scalar:
    """Returns how far the nearest disc is, seen from above, from the nearest person."""
    moving = Moving(plus(around.origin, end.moved), end.cos, end.sin, end.rate)
    found: list[Scalar] = []
    for disc in robot.discs:
        x, y = moving.turned(disc.forward_m, disc.left_m)
        away_m = jnp.sqrt((people_m[:, 0] - moving.place.x - x) ** 2 + (people_m[:, 1] - moving.place.y - y) ** 2)
        found.append(away_m.min() - PERSON_RADIUS_M - disc.radius_m)
    return functools.reduce(jnp.minimum, found)


def _clearance_m(robot: PlanarRobot, around: _Surroundings, end: _Robot) -> Scalar:
    """Returns how far the nearest disc is, seen from above, from the nearest obstacle at its heights."""
    moved = end.moved
    moving = Moving(plus(around.origin, moved), end.cos, end.sin, end.rate)
    nearest = jnp.full_like(moved.x, PARKING_M)
    for disc in robot.discs:
        beside = around.obstacles if len(robot.discs) == 1 else [_kept(disc, each) for each in around.obstacles]
        x, y = moving.turned(disc.forward_m, disc.left_m) if disc.forward_m or disc.left_m else (0.0, 0.0)
        nearest = jnp.minimum(nearest, distance_m(beside, moved.x + x, moved.y + y) - disc.radius_m)
    return nearest


def _kept(disc: Disc, obstacle: Obstacle) -> Obstacle:
    """Returns an obstacle, or one far away if it is above or below a disc."""
    half_m = disc.half_length_m if disc.flat else disc.half_length_m + disc.radius_m
    beside = jnp.abs(disc.height_m - obstacle.height) < half_m + obstacle.half_height
    return obstacle._replace(x=jnp.where(beside, obstacle.x, PARKING_M))


def _free_m(robot: PlanarRobot, obstacles: list[Obstacle]) -> list[Scalar]:
    """Returns how far a robot can go from where the control step began before each obstacle may push it."""
    reach_m = max(math.hypot(disc.forward_m, disc.left_m) + disc.radius_m + disc.margin_m for disc in robot.discs)
    found: list[Scalar] = []
    for each in obstacles:
        extent_m = jnp.abs(each.x) + jnp.abs(each.y) + each.half_x + each.half_y
        nil = jnp.zeros_like(each.x)
        found.append(distance_m([each], nil, nil) - (reach_m + _LEAST_M + _OF_COORDINATES * extent_m))
    return found


def _window_size(robot: PlanarRobot) -> int:
    central = len(robot.discs) == 1 and not (robot.discs[0].forward_m or robot.discs[0].left_m)
    return _AROUND_ONE_DISC if central else _AROUND_MORE


def _physics_step(robot: PlanarRobot, around: _Surroundings, before: _Robot, spent: _Spent) -> tuple[_Robot, _Spent]:
    given, robot = robot, _own(robot, around.factors)
    place = plus(around.origin, before.moved)
    moving = Moving(place, before.cos, before.sin, before.rate)
    pushed = push(robot, around.controls, before.activations, moving)
    instant = _Instant(before.moved, moving, _acting(robot, pushed, moving), before.acceleration, around.factors)
    # Which closes over no number of a lane.
    among = among_fewest(functools.partial(_among, given), few_counts(len(around.obstacles)))
    touchable = obstacles_needed(around.free_m, before.moved, before.acceleration)
    acceleration, contact_n, movers_n = among(touchable, (around.obstacles, around.bearings, instant))
    mass = _mass(robot, moving)
    rate = plus(before.rate, _integrated(robot, mass, pushed, acceleration), robot.step_s)
    moved = plus(before.moved, rate, robot.step_s)
    yaw = around.origin.yaw + moved.yaw
    after = _Robot(moved, jnp.cos(yaw), jnp.sin(yaw), rate, pushed.activations, acceleration)
    return after, _spent(robot, spent, pushed.power_w, contact_n, movers_n)


def _own(robot: PlanarRobot, factors: Float[jax.Array, "3"] | None) -> PlanarRobot:
    return robot if factors is None else varied_robot(robot, factors)


def _among(
    robot: PlanarRobot, count: int, given: tuple[list[Obstacle], list[list[Bearing]], _Instant]
) -> tuple[Planar, _Push, tuple[_Push | None, _Push | None]]:
    """Returns the acceleration that the first obstacles leave to a robot, and what they push with along x and y.

    And what people and other robots among them push with; None in a program without.
    """
    obstacles, bearings, instant = given
    robot = _own(robot, instant.factors)
    contacts = _contacts(robot, obstacles[:count], [each[:count] for each in bearings], instant)
    rate = instant.moving.rate
    targets = [-friction.damping * rate[friction.axis] for friction in robot.dry_frictions]
    dry = list(zip(robot.dry_frictions, targets, strict=True))
    acceleration = minimizer(_mass(robot, instant.moving), instant.acting, contacts, dry, instant.before)
    movers: list[_Push | None] = []
    for kind in ("person", "robot"):
        which: list[Flag | None] = [getattr(each, kind) for _ in robot.discs for each in obstacles[:count]]
        if getattr(obstacles[0], kind) is None:
            movers.append(None)
            continue
        solid, alive = (
            [
                touch._replace(weight=jnp.where(flag == mover, touch.weight, 0.0))
                for touch, flag in zip(contacts, which, strict=True)
            ]
            for mover in (False, True)
        )
        movers.append(contact_force(alive, acceleration))
        contacts = solid
    return acceleration, contact_force(contacts, acceleration), (movers[0], movers[1])


def _spent(
    robot: PlanarRobot,
    before: _Spent,
    power_w: Scalar,
    contact_n: _Push,
    movers_n: tuple[_Push | None, _Push | None],
) -> _Spent:
    x_n, y_n = contact_n
    after = before._replace(
        impulse_ns=before.impulse_ns + robot.step_s * jnp.sqrt(x_n**2 + y_n**2),
        push_x_ns=before.push_x_ns + robot.step_s * x_n,
        push_y_ns=before.push_y_ns + robot.step_s * y_n,
        energy_j=before.energy_j + robot.step_s * power_w,
    )
    for name, pushed_n in zip(("people_ns", "robots_ns"), movers_n, strict=True):
        if pushed_n is not None:
            x_n, y_n = pushed_n
            after = after._replace(
                push_x_ns=after.push_x_ns + robot.step_s * x_n,
                push_y_ns=after.push_y_ns + robot.step_s * y_n,
                **{name: getattr(before, name) + robot.step_s * jnp.sqrt(x_n**2 + y_n**2)},
            )
    return after


def _mass(robot: PlanarRobot, moving: Moving) -> Symmetric:
    """Returns the mass matrix; an offset centre of mass turns with the base."""
    x, y, w = (jnp.full_like(moving.cos, mass) for mass in robot.masses)
    lever_x, lever_y = moving.turned(*robot.lever)
    return Symmetric(x, jnp.zeros_like(x), -lever_y, y, lever_x, w)


def _acting(robot: PlanarRobot, pushed: Push, moving: Moving) -> Planar:
    """Returns the forces besides constraints: motors, joint damping, and the pull of an offset centre of mass."""
    lever_x, lever_y = moving.turned(*robot.lever)
    swing = moving.rate.yaw**2
    damped = [force - loss * rate for force, loss, rate in zip(pushed.force, robot.damping, moving.rate, strict=True)]
    return Planar(damped[0] + swing * lever_x, damped[1] + swing * lever_y, damped[2])


def _contacts(
    robot: PlanarRobot, obstacles: list[Obstacle], bearings: list[list[Bearing]], instant: _Instant
) -> list[Contact]:
    found: list[Contact] = []
    moved, moving = instant.moved, instant.moving
    for disc, hows in zip(robot.discs, bearings, strict=True):
        arm = moving.turned(disc.forward_m, disc.left_m) if disc.forward_m or disc.left_m else None
        x, y = (moved.x, moved.y) if arm is None else (moved.x + arm[0], moved.y + arm[1])
        for obstacle, how in zip(obstacles, hows, strict=True):
            found.append(contact(disc, touch(disc, obstacle, how, x, y), arm, moving.rate))
    return found


def _integrated(robot: PlanarRobot, mass: Symmetric, pushed: Push, acceleration: Planar) -> Planar:
    """Returns the acceleration that the integrator uses (MuJoCo documentation, "Numerical integration")."""
    if not (robot.implicit_damping or robot.implicit_motors):
        return acceleration
    heavier = mass
    if robot.implicit_damping:
        x, y, w = (robot.step_s * loss for loss in robot.damping)
        heavier = heavier._replace(xx=heavier.xx + x, yy=heavier.yy + y, ww=heavier.ww + w)
    for moment, slope in pushed.slopes:
        heavier = plus_square(heavier, moment, -robot.step_s * slope)
    if robot.uncoupled:
        heavier = heavier._replace(xy=mass.xy, xw=mass.xw, yw=mass.yw)
    return solved(heavier, times(mass, acceleration))
