"""The mjx engine: any robot that MJX can step, in a window of the obstacles nearest to it.

Robots that are apart from all obstacles are driven alone; the others are computed again, in order.

Small matrices are unrolled to sums of products. XLA calls a library for each lane's matrix product, Cholesky factor and
triangular solution, however small: of a base's three by three numbers the calls take most of the time. Unrolled, all
lanes are worked on at once, and a lane's sums have one order whatever lanes are beside it.
"""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax.custom_batching import custom_vmap
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal
from jaxtyping import Bool, Float, Int

from tasks.simulate.application.contract import Body, Joints, Motion, PeopleWork, Work, joints_kind
from tasks.simulate.application.robot_model import coordinates_at, pose_of, rest_control, velocity_of
from tasks.simulate.application.varied_physics import AGAINST_MASS, WITH_MASS, WITH_STRENGTH, force_columns
from tasks.simulate.engines.mjx.mjx_robot import (
    RobotModel,
    load_robot,
    mjx,
    nearest_obstacles,
    nearest_people,
    with_window,
)
from tasks.simulate.geometry.hull_distance import LaneObstacles, hull_distance_m, hull_to_people_m
from tasks.simulate.lane.control_step import LaneInputs, Mechanics

Result = TypeVar("Result")
# Larger factors are left to the library: written out they take long to compile.
_LARGEST = 10
_LONGEST_SUM = 8
_CALLS = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr"}


def unroll_small_matrices(function: Callable[..., Result]) -> Callable[..., Result]:
    """Returns a function that gives the same as one of JAX, with its small matrices' algebra written out."""

    def call(*arguments: Any) -> Result:  # noqa: ANN401 - trees of arrays
        closed, form = jax.make_jaxpr(function, return_shape=True)(*arguments)
        arrays = _outputs(closed.jaxpr, closed.consts, jax.tree.leaves(arguments))
        return jax.tree.unflatten(jax.tree.structure(form), arrays)

    return call


def _outputs(jaxpr: Jaxpr, consts: Sequence[Any], arguments: Sequence[Any]) -> list[Any]:
    known: dict[Any, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *arguments], strict=True))

    def read(variable: Any) -> Any:  # noqa: ANN401 - a variable's array
        return variable.val if isinstance(variable, Literal) else known[variable]

    for equation in jaxpr.eqns:
        found = _results(equation, [read(variable) for variable in equation.invars])
        known.update(zip(equation.outvars, found, strict=True))
    return [read(variable) for variable in jaxpr.outvars]


def _results(equation: JaxprEqn, given: list[Any]) -> Sequence[Any]:
    name, parameters = equation.primitive.name, equation.params
    if name in _CALLS:
        return _closed(parameters[_CALLS[name]], given)
    if name in _LOOPS:
        return _LOOPS[name](parameters, given)
    if name in _ALGEBRA and _is_small(name, given, parameters):
        return [_ALGEBRA[name](*given, parameters).astype(given[0].dtype)]
    found = equation.primitive.bind(*given, **parameters)
    return found if equation.primitive.multiple_results else [found]


def _closed(closed: ClosedJaxpr | Jaxpr, given: Sequence[Any]) -> list[Any]:
    if isinstance(closed, ClosedJaxpr):
        return _outputs(closed.jaxpr, closed.consts, given)
    return _outputs(closed, (), given)


def _is_small(name: str, given: list[Any], parameters: dict[str, Any]) -> bool:
    if name == "dot_general":
        return all(array.size for array in given)
    return given[0].shape[-1] <= _LARGEST and parameters.get("left_side", True)


def _switch(parameters: dict[str, Any], given: list[Any]) -> Sequence[Any]:
    branches = [lambda *arrays, branch=branch: _closed(branch, arrays) for branch in parameters["branches"]]
    return jax.lax.switch(given[0], branches, *given[1:])


def _while(parameters: dict[str, Any], given: list[Any]) -> Sequence[Any]:
    asked, done = parameters["cond_nconsts"], parameters["body_nconsts"]
    tests, bodies, first = given[:asked], given[asked : asked + done], given[asked + done :]
    return jax.lax.while_loop(
        lambda carry: _closed(parameters["cond_jaxpr"], [*tests, *carry])[0],
        lambda carry: _closed(parameters["body_jaxpr"], [*bodies, *carry]),
        first,
    )


def _scan(parameters: dict[str, Any], given: list[Any]) -> Sequence[Any]:
    fixed, carried = parameters["num_consts"], parameters["num_carry"]
    consts, first, each = given[:fixed], given[fixed : fixed + carried], given[fixed + carried :]

    def body(carry: list[Any], one: list[Any]) -> tuple[list[Any], list[Any]]:
        found = _closed(parameters["jaxpr"], [*consts, *carry, *one])
        return found[:carried], found[carried:]

    kept = {name: parameters[name] for name in ("length", "reverse", "unroll")}
    last, outputs = jax.lax.scan(body, first, each, **kept)
    return [*last, *outputs]


def _product(left: jax.Array, right: jax.Array, parameters: dict[str, Any]) -> jax.Array:
    """Returns what ``dot_general`` does: batches first, then what is left of one factor, then of the other."""
    (over_left, over_right), (of_left, of_right) = parameters["dimension_numbers"]
    left, rows = _sorted(left, of_left, over_left)
    right, columns = _sorted(right, of_right, over_right)
    batches = len(of_left)
    left = left.reshape(*left.shape[: batches + rows], *[1] * columns, left.shape[-1])
    right = right.reshape(*right.shape[:batches], *[1] * rows, *right.shape[batches:])
    terms = left * right
    if terms.shape[-1] > _LONGEST_SUM:
        return terms.sum(axis=-1)
    return sum((terms[..., k] for k in range(1, terms.shape[-1])), start=terms[..., 0])


def _sorted(array: jax.Array, batches: Sequence[int], summed: Sequence[int]) -> tuple[jax.Array, int]:
    """Returns a factor with batches first and what is summed over as its one last axis, and how many axes it keeps."""
    kept = [axis for axis in range(array.ndim) if axis not in {*batches, *summed}]
    array = jnp.transpose(array, (*batches, *kept, *summed))
    first = array.shape[: array.ndim - len(summed)]
    return array.reshape(*first, -1), len(kept)


def _cholesky(matrix: jax.Array, _: dict[str, Any]) -> jax.Array:
    """Returns the lower factor, column by column (Golub and Van Loan, Matrix Computations, section 4.2)."""
    size = matrix.shape[-1]
    zero = jnp.zeros_like(matrix[..., 0, 0])
    factor = [[zero] * size for _ in range(size)]
    for j in range(size):
        factor[j][j] = jnp.sqrt(matrix[..., j, j] - sum((factor[j][k] ** 2 for k in range(j)), start=zero))
        for i in range(j + 1, size):
            known = sum((factor[i][k] * factor[j][k] for k in range(j)), start=zero)
            factor[i][j] = (matrix[..., i, j] - known) / factor[j][j]
    return jnp.stack([jnp.stack(row, axis=-1) for row in factor], axis=-2)


def _triangular(matrix: jax.Array, right: jax.Array, parameters: dict[str, Any]) -> jax.Array:
    """Returns the solution of a triangular system, by substitution."""
    matrix = jnp.swapaxes(matrix, -1, -2) if parameters["transpose_a"] else matrix
    size, forward = matrix.shape[-1], parameters["lower"] != parameters["transpose_a"]
    rows: dict[int, jax.Array] = {}
    for i in range(size) if forward else range(size - 1, -1, -1):
        known = [matrix[..., i, k, None] * row for k, row in rows.items()]
        rows[i] = right[..., i, :] - sum(known[1:], start=known[0]) if known else right[..., i, :]
        if not parameters["unit_diagonal"]:
            rows[i] = rows[i] / matrix[..., i, i, None]
    return jnp.stack([rows[i] for i in range(size)], axis=-2)


_LOOPS: dict[str, Callable[[dict[str, Any], list[Any]], Sequence[Any]]] = {
    "cond": _switch,
    "while": _while,
    "scan": _scan,
}
_ALGEBRA: dict[str, Callable[..., jax.Array]] = {
    "dot_general": _product,
    "cholesky": _cholesky,
    "triangular_solve": _triangular,
}


Tree = TypeVar("Tree")
Lanes = TypeVar("Lanes")
# Driven again together: with fewer, the calls cost more than the work; with more, sound lanes fill up the last ones.
_TOGETHER = 32


def recompute_lanes(
    first: Lanes, sound: Bool[jax.Array, "lanes"], again: Callable[[Tree], Lanes], given: Tree, lanes: int
) -> Lanes:
    """Returns what was found for all lanes, with those that are not sound found again.

    Args:
        first: What was found, lanes first.
        sound: The lanes for which it stands.
        again: Finds the same for some lanes.
        given: What it finds it from, lanes first.
        lanes: How many there are.
    """
    together = min(lanes, _TOGETHER)
    order, wrong = jnp.argsort(sound, stable=True), jnp.sum(~sound)

    def more(carry: tuple[jax.Array, Lanes]) -> jax.Array:
        return carry[0] < wrong

    def some(carry: tuple[jax.Array, Lanes]) -> tuple[jax.Array, Lanes]:
        begin, found = carry
        chosen = jax.lax.dynamic_slice(order, (begin,), (together,))
        better = again(jax.tree.map(lambda array: array[chosen], given))

        def put(old: jax.Array, new: jax.Array) -> jax.Array:
            keep = sound[chosen].reshape(-1, *[1] * (old.ndim - 1))
            return old.at[chosen].set(jnp.where(keep, old[chosen], new), unique_indices=True)

        return begin + together, jax.tree.map(put, found, better)

    _, found = jax.lax.while_loop(more, some, (jnp.zeros((), wrong.dtype), first))
    return found


Control = Float[jax.Array, "actuators"]


class Given(NamedTuple):
    """What a lane's control step is driven from.

    Attributes:
        near_m: From the robot's place to the nearest obstacle or person, seen from above.
        physics: Factors of mass, friction and motor strength; None in a program without.
        people_m: Where the nearest people stand (x, y); likewise.
    """

    window: LaneObstacles
    near_m: Float[jax.Array, ""]
    body: Body
    control: Control
    physics: Float[jax.Array, "3"] | None = None
    people_m: Float[jax.Array, "slots 2"] | None = None


class Driven(NamedTuple):
    """What a control step's physics did to a robot, and what people pushed with; None in a program without."""

    body: Body
    work: Work
    people_ns: Float[jax.Array, ""] | None = None


def mjx_mechanics(path: Path) -> Mechanics:
    """Returns the robot of a ``robot.xml`` on this engine.

    Raises:
        RobotRefused: MJX cannot step it; says which element, and the remedy.
    """
    robot = load_robot(path)

    @functools.cache
    def among(*, prisms: bool, people: bool) -> RobotModel:
        if not (prisms or people):
            return robot
        with jax.ensure_compile_time_eval():  # it is asked for while a program is traced, and kept for the next one
            return load_robot(path, prisms=prisms, people=people)

    def drive_it(inputs: LaneInputs, body: Body, control: Control) -> Motion:
        own = among(prisms=bool(len(inputs.obstacles.prisms)), people=inputs.standing_m is not None)
        return drive(own, inputs, body, control)

    return Mechanics(
        engine="mjx",
        hull=robot.hull,
        actuators=robot.actuators,
        rest_control=rest_control(robot.host).astype(np.float32),
        first_body=functools.partial(first_body, robot),
        drive=drive_it,
    )


def first_body(robot: RobotModel, start: Float[jax.Array, "3"]) -> Body:
    """Returns a robot at rest at its start."""
    qpos = coordinates_at(robot.base, jnp.asarray(robot.rest), start, jnp)
    joints = joints_kind(free=robot.base.free)(qpos, jnp.zeros(robot.host.nv))
    return _body(robot, joints, jnp.asarray(robot.rest_act), jnp.zeros(robot.host.nv))


def drive(robot: RobotModel, inputs: LaneInputs, body: Body, control: Control) -> Motion:
    """Returns what a control step's physics does to a robot.

    Args:
        robot: The robot.
        inputs: The lane's, with the obstacles.
        body: The robot at the step's beginning.
        control: One number for each actuator.
    """
    window, near_m = nearest_obstacles(inputs.solids, body.qpos[:2])
    standing_m, people_m = inputs.standing_m, None
    if standing_m is not None:
        people_m, person_m = nearest_people(standing_m, body.qpos[:2])
        near_m = jnp.minimum(near_m, person_m)
    driven = _drive(robot)(Given(window, near_m, body, control, inputs.physics, people_m))
    clearance_m = hull_distance_m(robot.parts, window, driven.body.qpos)
    if standing_m is None or driven.people_ns is None:
        return Motion(driven.body, driven.work, clearance_m)
    met = PeopleWork(driven.people_ns, hull_to_people_m(robot.parts, standing_m, driven.body.qpos))
    return Motion(driven.body, driven.work, clearance_m, met)


def _drive(robot: RobotModel) -> custom_vmap:
    """Returns a function that drives a lane, and many at once with less work than each by itself."""

    @custom_vmap
    def one(given: Given) -> Driven:
        lanes = jax.tree.map(lambda array: jnp.asarray(array)[None], given)
        return jax.tree.map(lambda array: array[0], many(lanes, 1))

    def many(given: Given, lanes: int) -> Driven:
        first, sound = jax.vmap(unroll_small_matrices(functools.partial(drive_alone, robot)))(given)
        again = jax.vmap(unroll_small_matrices(functools.partial(drive_among, robot)))
        return recompute_lanes(first, sound, again, given, lanes)

    @one.def_vmap
    def _(lanes: int, batched: list[Given], given: Given) -> tuple[Driven, Driven]:
        whole = jax.tree.map(
            lambda array, split: array if split else jnp.broadcast_to(array, (lanes, *jnp.shape(array))),
            given,
            batched[0],
        )
        driven = many(whole, lanes)
        return driven, jax.tree.map(lambda _: True, driven)

    return one


def drive_alone(robot: RobotModel, given: Given) -> tuple[Driven, Bool[jax.Array, ""]]:
    """Returns what a control step does where there are no obstacles, and whether none can have been touched."""
    center, free = given.body.qpos[:2], robot.free
    model = varied_model(free.model, robot.host, given.physics)

    def physics_step(
        carry: tuple[Body, jax.Array, jax.Array], _: None
    ) -> tuple[tuple[Body, jax.Array, jax.Array], None]:
        before, energy_j, reach_m = carry
        data = mjx.step(model, _data(free.data, before, given.control))
        # Where its geoms were when contacts were looked for.
        away_m = jnp.sqrt(jnp.sum((data.geom_xpos[free.geoms, :2] - center) ** 2, axis=-1)) + free.reach_m
        energy_j += _power_w(data) * free.model.opt.timestep
        return (_after(robot, data), energy_j, jnp.maximum(reach_m, away_m.max())), None

    zero = jnp.zeros(())
    (after, energy_j, reach_m), _ = jax.lax.scan(
        physics_step, (given.body, zero, zero), None, length=robot.physics_steps
    )
    return Driven(after, Work(zero, jnp.zeros(2), energy_j), _nobody_ns(given)), reach_m < given.near_m


def drive_among(robot: RobotModel, given: Given) -> Driven:
    """Returns what a control step does among the obstacles of a window."""
    model = varied_model(with_window(robot, given.window, given.people_m), robot.host, given.physics)
    step_s = model.opt.timestep

    def physics_step(before: Driven, _: None) -> tuple[Driven, None]:
        work, people_ns = before.work, before.people_ns
        data = mjx.step(model, _data(robot.data, before.body, given.control))
        push_n = whole_n = _push_n(robot, data, robot.slots)
        if people_ns is not None:
            people_n = _push_n(robot, data, robot.person_slots)
            whole_n = push_n + people_n
            people_ns = people_ns + jnp.sqrt(jnp.sum(people_n**2)) * step_s
        worked = Work(
            work.impulse_ns + jnp.sqrt(jnp.sum(push_n**2)) * step_s,
            work.push_ns + whole_n * step_s,
            work.energy_j + _power_w(data) * step_s,
        )
        return Driven(_after(robot, data), worked, people_ns), None

    zero = jnp.zeros(())
    first = Driven(given.body, Work(zero, jnp.zeros(2), zero), _nobody_ns(given))
    return jax.lax.scan(physics_step, first, None, length=robot.physics_steps)[0]


def _nobody_ns(given: Given) -> Float[jax.Array, ""] | None:
    return None if given.people_m is None else jnp.zeros(())


def varied_model(model: mjx.Model, host: mujoco.MjModel, factors: Float[jax.Array, "3"] | None) -> mjx.Model:
    """Returns a model whose mass, friction and motor strength are so many times as large; the same without factors.

    Whatever MuJoCo derives from a mass goes with it or with its inverse: armature counts as mass.
    """
    if factors is None:
        return model
    mass, friction, strength = factors[0], factors[1], factors[2]
    columns = {name: jnp.asarray(scaled) for name, scaled in force_columns(host).items()}
    own = {name: getattr(model, name) for name in columns}
    return model.replace(
        **{name: getattr(model, name) * mass for name in WITH_MASS},
        **{name: getattr(model, name) / mass for name in AGAINST_MASS},
        **{name: getattr(model, name) * strength for name in WITH_STRENGTH},
        **{name: jnp.where(columns[name], value * strength, value) for name, value in own.items()},
        geom_friction=model.geom_friction.at[:, 0].multiply(friction),
    )


def _data(data: mjx.Data, before: Body, control: Control) -> mjx.Data:
    joints = before.joints or Joints(before.qpos, before.qvel)
    return data.replace(
        qpos=joints.qpos, qvel=joints.qvel, act=before.act, qacc_warmstart=before.warmstart, ctrl=control
    )


def _after(robot: RobotModel, data: mjx.Data) -> Body:
    return _body(robot, joints_kind(free=robot.base.free)(data.qpos, data.qvel), data.act, data.qacc_warmstart)


def _body(robot: RobotModel, joints: Joints, act: jax.Array, warmstart: jax.Array) -> Body:
    pose, velocity = pose_of(robot.base, joints.qpos, jnp), velocity_of(robot.base, *joints, jnp)
    return Body(pose, velocity, act, warmstart, joints if robot.base.articulated else None)


def _power_w(data: mjx.Data) -> Float[jax.Array, ""]:
    """Returns what the actuators spend, each by itself: sums over coordinates would depend on where the axes point."""
    speeds = data._impl.actuator_velocity  # noqa: SLF001 - MJX has no public way to it
    return jnp.sum(jnp.abs(data.actuator_force * speeds))


def _push_n(robot: RobotModel, data: mjx.Data, slots: Int[np.ndarray, "slots"]) -> Float[jax.Array, "2"]:
    """Returns the force of what is in slots on the robot in the plane; floor, limits and dry friction do not count.

    What acts on the base's first two coordinates is the net force on the whole robot.
    """
    if robot.only_obstacles_hold:
        return data.qfrc_constraint[:2]
    inner = data._impl  # noqa: SLF001 - MJX has no public way to a contact's force
    contact = inner.contact
    by_obstacle = jnp.isin(contact.geom, slots).any(axis=1)
    first, count = contact.efc_address, np.where(contact.dim == 1, 1, 2 * (contact.dim - 1))
    if robot.host.opt.cone:
        count = contact.dim
    rows = np.concatenate([first[k] + np.arange(count[k]) for k in range(len(first))])
    owners = np.repeat(np.arange(len(first)), count)
    forces = jnp.where(by_obstacle[owners], inner.efc_force[rows], 0.0)
    return forces @ inner.efc_J[rows, :2]
