"""Reads a robot's file, and refuses one that takes away what a robot is judged by: contacts, weight, its own motors.

`RULES` is the list, with a reason each; docs/guide/robots.md shows it. Its rules look at what MuJoCo compiled, so that
defaults, includes and attached models are seen as they come out. What is only strange is a line of `simyard plan`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from specs.data.episode import CONTROL_S
from tasks.simulate.application.mjcf_check import RobotRefused, check_mjcf
from tasks.simulate.application.robot_model import (
    FLOOR,
    PLANAR_JOINTS,
    Base,
    actuator_label,
    base_of,
    body_label,
    collision_bits,
    compile_robot,
    geom_label,
    joint_label,
    no_log,
    outline_of,
    resting,
    robot_geoms,
    without_shape,
    word_of,
)
from tasks.simulate.application.robot_sensors import FileSensors, file_sensors

_FLOOR_FIELDS = ("condim", "friction", "solref", "solimp", "solmix", "margin", "gap", "priority")
_REFUSES = "Simyard refuses the robot:"


def read_robot_mjcf(path: Path) -> mujoco.MjSpec:
    """Returns a robot's specification without the scenery that its file may hold beside it.

    A time step that does not divide a control step is shortened until it does. A robot with a free joint gets a level
    floor at height 0: the one of its own file, if there is one, or one that is as rough as MuJoCo's default.

    Raises:
        RobotRefused: The file is missing, is not MJCF, holds what no robot needs, its robot cannot be driven about, or
            what it is judged by is taken away; of the last, all of it.
    """
    spec = _read(path)
    robot = _inspected(spec)
    faults = [f"robot.xml: {fault}" for rule in RULES for fault in rule.faults(robot)]
    if faults:
        raise RobotRefused("\n  ".join([_REFUSES, *dict.fromkeys(faults)]))
    _shorten_steps(spec)
    return spec


def strange_in_robot(path: Path) -> tuple[str, ...]:
    """Returns what is strange in a robot's file, and drives all the same, for a person; nothing of one that is refused.

    Raises:
        RobotRefused: The file cannot be read.
    """
    robot = _inspected(_read(path))
    return tuple(dict.fromkeys(line for find in _STRANGE for line in find(robot)))


def read_file_sensors(path: Path) -> FileSensors:
    """Returns the cameras and sensors of a robot's file.

    Raises:
        RobotRefused: The file cannot be read.
    """
    robot = _inspected(_read(path))
    return file_sensors(robot.spec, robot.model, robot.at_rest)


def _read(path: Path) -> mujoco.MjSpec:
    """Returns the specification of a robot that can be driven about, whatever else is to be said of it."""
    check_mjcf(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _refuse_our_names(spec)
        floor = next((geom for geom in spec.worldbody.geoms if _is_floor(geom)), None)
        ground = {} if floor is None else {name: np.copy(getattr(floor, name)) for name in _FLOOR_FIELDS}
        _delete_scenery(spec)
        base = base_of(compile_robot(spec))
        if base.free:
            _add_floor(spec, ground)
        if not spec.option.timestep > 0.0:
            raise RobotRefused(f"robot.xml: option timestep {spec.option.timestep:g} s: must be above 0")
        compile_robot(spec)
    except (ValueError, OSError) as exc:
        raise RobotRefused(f"{path.name}: {' '.join(str(exc).split())}") from exc
    return spec


def _is_floor(geom: mujoco.MjsGeom) -> bool:
    return geom.type == mujoco.mjtGeom.mjGEOM_PLANE and bool(geom.contype or geom.conaffinity)


def _refuse_our_names(spec: mujoco.MjSpec) -> None:
    """Refuses a robot that gives its parts names of ours: it would be taken for the floor or for a wall."""
    parts = (*spec.bodies, *spec.geoms, *spec.joints, *spec.sites, *spec.actuators, *spec.sensors)
    for part in parts:
        if part.name.startswith(_OUR_NAMES):
            allowed = f"names that begin with {', '.join(_OUR_NAMES)} are Simyard's own: give it another"
            raise RobotRefused(f"robot.xml: name {part.name!r}: {allowed}")


def _delete_scenery(spec: mujoco.MjSpec) -> None:
    """Deletes what is fixed to the world, with everything in it: the worlds bring their own."""
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    for body in list(spec.worldbody.bodies):
        if not _moves(body):
            spec.delete(body)


def _moves(body: mujoco.MjsBody) -> bool:
    return bool(body.joints) or any(_moves(child) for child in body.bodies)


def _add_floor(spec: mujoco.MjSpec, ground: Mapping[str, object]) -> None:
    bits = collision_bits(spec)
    floor = without_shape(spec.worldbody.add_geom(name=FLOOR))
    floor.type, floor.size = mujoco.mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 1.0]
    floor.contype, floor.conaffinity = bits
    for name, value in ground.items():
        setattr(floor, name, value)


def _shorten_steps(spec: mujoco.MjSpec) -> None:
    steps = int(np.ceil(CONTROL_S / spec.option.timestep - 1e-6))
    spec.option.timestep = CONTROL_S / max(steps, 1)


_OUR_NAMES = ("simyard/", "solid/", "box-slot-", "cylinder-slot-", "planar-probe-")


@dataclass(frozen=True, eq=False)
class _Robot:
    """A robot as its file makes it, without obstacles; a free base on its floor.

    Attributes:
        at_rest: As it stands at the start.
        base: How it stands in the world.
        hull: Its geoms that collide.
        low_m, high_m: Their heights above the floor.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    at_rest: mujoco.MjData
    base: Base
    hull: list[int]
    low_m: float
    high_m: float


def _inspected(spec: mujoco.MjSpec) -> _Robot:
    model = compile_robot(spec)
    at_rest, hull = resting(model), robot_geoms(model)
    outline = outline_of(model, at_rest, hull)
    low_m, high_m = (outline[:, 2] - outline[:, 3]).min(), (outline[:, 2] + outline[:, 3]).max()
    return _Robot(spec, model, at_rest, base_of(model), hull, float(low_m), float(high_m))


class Rule(NamedTuple):
    """What a robot's file may not hold.

    Attributes:
        what: What is refused, as docs/guide/robots.md has it.
        allowed: What is not.
        why: What it would take away.
        find: Yields each culprit with its value.
    """

    what: str
    allowed: str
    why: str
    find: Callable[[_Robot], Iterator[str]]

    def faults(self, robot: _Robot) -> Iterator[str]:
        """Yields a line for each culprit: what, why, and what to do."""
        for found in self.find(robot):
            yield f"{found}: {self.why}: {self.allowed}"


# Of what is refused: a wall must stop a robot within centimetres, and its push must be seen.
_DISABLED = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    mujoco.mjtDisableBit.mjDSBL_ACTUATION,
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
)
_ENABLED = (mujoco.mjtEnableBit.mjENBL_OVERRIDE, mujoco.mjtEnableBit.mjENBL_IPC)
_LEAST_GRAVITY, _MOST_GRAVITY = 1.0, 30.0
_AIR_DENSITY, _AIR_VISCOSITY = 1.5, 1e-4
_MOST_TOLERANCE = 1e-3
# Newton's method needs two or three; the others need many.
_FEWEST_ITERATIONS = {mujoco.mjtSolver.mjSOL_NEWTON: 1, mujoco.mjtSolver.mjSOL_CG: 10, mujoco.mjtSolver.mjSOL_PGS: 10}
_FEWEST_CCD_ITERATIONS = 10
_LIGHTEST_KG = 0.05
_LEAST_MEMORY_BYTES = 1 << 20
_SOFTEST_S, _SOFTEST_STIFFNESS = 0.1, 100.0
_WIDEST_M, _WEAKEST = 0.05, 0.01
_MOST_FLOATING = 0.5
_HIGHEST_M, _LOWEST_M = 0.3, 0.03
# Whoever walks is often let fall at the start: gymnasium's ant from 0.5 m.
_HIGHEST_FALL_M = 1.0
# What it is thrown with is seen within tenths of a second; who stands up from its knees rises less.
_THROWN_WITHIN_S, _MOST_STEPS, _HIGHEST_THROW_M = 0.5, 500, 0.5
_LEAST_HULL = 0.5


def _flags(robot: _Robot) -> Iterator[str]:
    option = robot.model.opt
    for bit in _DISABLED:
        if option.disableflags & bit:
            yield f"option flag {word_of(bit, 'mjDSBL_')} disable"
    for bit in _ENABLED:
        if option.enableflags & bit:
            yield f"option flag {word_of(bit, 'mjENBL_')} enable"


def _motors_off(robot: _Robot) -> Iterator[str]:
    groups, off = robot.model.actuator_group, robot.model.opt.disableactuator
    if off and all(off >> int(group) & 1 for group in groups):
        yield f"option actuatorgroupdisable: groups {_numbers(sorted(set(groups.tolist())))} are all its motors"


def _gravity(robot: _Robot) -> Iterator[str]:
    x, y, z = robot.model.opt.gravity.tolist()
    if x or y or (robot.base.free and not -_MOST_GRAVITY <= z <= -_LEAST_GRAVITY):
        yield f"option gravity {_numbers((x, y, z))}"
    if robot.base.free and robot.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        yield "option flag gravity disable"


def _medium(robot: _Robot) -> Iterator[str]:
    option = robot.model.opt
    if option.density > _AIR_DENSITY or option.viscosity > _AIR_VISCOSITY:
        yield f"option density {option.density:g}, viscosity {option.viscosity:g}"
    if option.wind.any():
        yield f"option wind {_numbers(option.wind)}"


def _floats(robot: _Robot) -> Iterator[str]:
    if robot.base.free:
        masses, shares = robot.model.body_mass, robot.model.body_gravcomp
        share = float((masses * shares).sum() / masses.sum())
        if share > _MOST_FLOATING:
            names = ", ".join(body_label(robot.model, int(body)) for body in np.flatnonzero(shares)[:_SHOWN])
            yield f"gravcomp of {names}: {100 * share:.0f} % of the robot's weight"


def _weight(robot: _Robot) -> Iterator[str]:
    total_kg = float(robot.model.body_mass.sum())
    if total_kg < _LIGHTEST_KG:
        yield f"a mass of {total_kg:g} kg in all"


def _solver(robot: _Robot) -> Iterator[str]:
    option = robot.model.opt
    fewest = _FEWEST_ITERATIONS[mujoco.mjtSolver(option.solver)]
    if option.iterations < fewest:
        yield f"option iterations {option.iterations} of solver {word_of(mujoco.mjtSolver(option.solver), 'mjSOL_')}"
    if option.ccd_iterations < _FEWEST_CCD_ITERATIONS:
        yield f"option ccd_iterations {option.ccd_iterations}"
    for name in ("tolerance", "ccd_tolerance"):
        if getattr(option, name) > _MOST_TOLERANCE:
            yield f"option {name} {getattr(option, name):g}"


def _memory(robot: _Robot) -> Iterator[str]:
    if 0 <= robot.spec.memory < _LEAST_MEMORY_BYTES:
        yield f"size memory {robot.spec.memory:,} bytes"


def _soft_contacts(robot: _Robot) -> Iterator[str]:
    """Yields the geoms, the floor and the default, which walls take theirs from, whose contacts would give way."""
    model = robot.model
    geoms = [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    floor = {geom: "geom of the floor" for geom in geoms if model.geom(geom).name == FLOOR}
    yield from _soft("default geom", robot.spec.default.geom)
    for geom in geoms:
        yield from _soft(floor.get(geom) or geom_label(model, geom), model.geom(geom))
    for number in range(model.npair):
        yield from _soft(f"contact pair {number + 1}", model.pair(number))


def _soft(label: str, given: Any) -> Iterator[str]:  # noqa: ANN401 - a geom of a specification, of a model, or a pair
    first, second = (float(each) for each in given.solref[:2])
    _, most, width_m, *_ = (float(each) for each in given.solimp)
    timed = first > 0 and second > 0
    if (timed and first * second > _SOFTEST_S) or (not timed and (-first < _SOFTEST_STIFFNESS or second > 0)):
        yield f"{label}: solref {_numbers((first, second))}"
    if most < _WEAKEST or width_m > _WIDEST_M:
        yield f"{label}: solimp {_numbers(given.solimp)}"
    for name in ("margin", "gap"):
        if (value_m := float(np.ravel(getattr(given, name))[0])) < 0:
            yield f"{label}: {name} {value_m:g}"


def _left_out(robot: _Robot) -> Iterator[str]:
    """Yields the excludes that are about the world."""
    model = robot.model
    for signature in model.exclude_signature.tolist():
        bodies = (signature >> 16, signature & 0xFFFF)
        other = [body for body in bodies if model.body_weldid[body]]
        if len(other) < len(bodies):
            name = body_label(model, other[0]) if other else "the world"
            yield f"contact exclude of {name} and the world"


def _tethers(robot: _Robot) -> Iterator[str]:
    """Yields what holds the base back that is no wall."""
    model = robot.model
    own = set() if robot.base.free else set(range(len(PLANAR_JOINTS)))
    for joint in sorted(own):
        label = joint_label(model, joint)
        if model.jnt_limited[joint]:
            yield f"{label}: range {_numbers(model.jnt_range[joint])}"
        if model.jnt_stiffness[joint] or model.jnt_stiffnesspoly[joint].any():
            yield f"{label}: stiffness {model.jnt_stiffness[joint]:g}"
    for number in range(model.neq):
        if _ties_to_world(robot, number, own):
            kind = word_of(mujoco.mjtEq(model.eq_type[number]), "mjEQ_")
            yield f"equality {model.equality(number).name or number + 1} ({kind})"
    for number in range(model.ntendon):
        if _pulls_base(robot, number, own) and (model.tendon_limited[number] or model.tendon_stiffness[number]):
            yield f"tendon {model.tendon(number).name or number + 1}"


def _elsewhere(robot: _Robot) -> Iterator[str]:
    """Yields what makes the base's coordinates another place than the base's."""
    model = robot.model
    for joint in () if robot.base.free else range(len(PLANAR_JOINTS)):
        if model.qpos0[joint]:
            yield f"{joint_label(model, joint)}: ref {model.qpos0[joint]:g}"
        if PLANAR_JOINTS[joint][0] == mujoco.mjtJoint.mjJNT_HINGE and model.jnt_pos[joint][:2].any():
            yield f"{joint_label(model, joint)}: pos {_numbers(model.jnt_pos[joint])}"


def _ties_to_world(robot: _Robot, number: int, own: set[int]) -> bool:
    model, kind = robot.model, mujoco.mjtEq(robot.model.eq_type[number])
    ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
    if kind == mujoco.mjtEq.mjEQ_JOINT:
        return bool(own.intersection(ends))
    if kind == mujoco.mjtEq.mjEQ_TENDON:
        return any(_pulls_base(robot, end, own) for end in ends if end >= 0)
    if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return False
    of_sites = model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE
    bodies = [int(model.site_bodyid[end]) if of_sites else end for end in ends]
    return any(model.body_weldid[body] == 0 for body in bodies)


def _pulls_base(robot: _Robot, tendon: int, own: set[int]) -> bool:
    """Returns whether a tendon goes over one of the base's joints, or from the world."""
    model, first = robot.model, int(robot.model.tendon_adr[tendon])
    bodies = {mujoco.mjtWrap.mjWRAP_SITE: model.site_bodyid, mujoco.mjtWrap.mjWRAP_SPHERE: model.geom_bodyid}
    for place in range(first, first + int(model.tendon_num[tendon])):
        kind, part = mujoco.mjtWrap(model.wrap_type[place]), int(model.wrap_objid[place])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT and part in own:
            return True
        if kind in bodies and model.body_weldid[bodies[kind][part]] == 0:
            return True
    return False


def _heights(robot: _Robot) -> Iterator[str]:
    falls = mujoco.mjtJoint.mjJNT_FREE in robot.model.jnt_type
    if robot.low_m > (_HIGHEST_FALL_M if falls else _HIGHEST_M) or robot.high_m < _LOWEST_M:
        yield f"the hull is from {robot.low_m:.3g} to {robot.high_m:.3g} m above the floor at the start"


def _thrown(robot: _Robot) -> Iterator[str]:
    """Yields how high a robot that nobody drives is thrown: by what of it is in the floor, or by its springs."""
    model, base = robot.model, robot.base
    gravity = -float(model.opt.gravity[2])
    if not base.free or gravity <= 0:
        return
    data, most_m = resting(model), 0.0
    mujoco.mj_comPos(model, data)
    begin_m = data.subtree_com[base.body][2]
    with no_log():
        for _ in range(min(_MOST_STEPS, int(_THROWN_WITHIN_S / model.opt.timestep))):
            mujoco.mj_step(model, data)
            mujoco.mj_subtreeVel(model, data)
            upward = max(data.subtree_linvel[base.body][2], 0.0)
            most_m = max(most_m, data.subtree_com[base.body][2] - begin_m + upward**2 / (2 * gravity))
    if most_m > _HIGHEST_THROW_M:
        yield f"the floor, or a spring, throws the robot {most_m:.2g} m up at the start"


def _small_hull(robot: _Robot) -> Iterator[str]:
    hull_m, seen_m, widest = _reaches_m(robot)
    if hull_m < _LEAST_HULL * seen_m:
        yield f"{geom_label(robot.model, widest)} reaches {seen_m:.2g} m, and what collides {hull_m:.2g} m"


def _reaches_m(robot: _Robot) -> tuple[float, float, int]:
    """Returns how far the hull reaches from the base's axis, how far what is seen, and the geom that reaches there."""
    model, axis = robot.model, robot.at_rest.xpos[robot.base.body][:2]
    reaches = {
        geom: float((np.hypot(*(points[:, :2] - axis).T) + points[:, 3]).max())
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] and model.geom_type[geom] not in _ENDLESS
        for points in [outline_of(model, robot.at_rest, [geom])]
    }
    widest = max(reaches, key=lambda geom: reaches[geom])
    return max((reaches.get(geom, np.inf) for geom in robot.hull), default=0.0), reaches[widest], widest


_ENDLESS = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
_SHOWN = 3


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):g}" for value in values)


RULES: tuple[Rule, ...] = (
    Rule(
        "`option flag`: `contact`, `constraint`, `actuation` or `sensor` disabled, `override` or `ipc` enabled",
        "leave the flag as MuJoCo has it",
        "contacts, motors and what measures them are what a robot is judged by",
        _flags,
    ),
    Rule(
        "`actuatorgroupdisable` of all motors",
        "leave out the groups of its motors",
        "a robot is judged by how its own motors drive it",
        _motors_off,
    ),
    Rule(
        "`option gravity` with an x or a y; for a free base also without a z from -30 to -1, or disabled",
        "give 0 0 -9.81, enabled",
        "gravity would carry it, or let it float over what stands in its way",
        _gravity,
    ),
    Rule(
        "`density` above 1.5, `viscosity` above 1e-4, any `wind`",
        "set 0, or those of air, and no wind",
        "what is around it would carry it, or hold it back",
        _medium,
    ),
    Rule(
        "`gravcomp` of more than half the weight of a free base",
        "give it to arms alone, to at most 50 % of the weight",
        "it would float over what stands in its way",
        _floats,
    ),
    Rule(
        "`iterations` below 1 (Newton) or 10 (CG, PGS), `ccd_iterations` below 10, "
        "`tolerance` or `ccd_tolerance` above 1e-3",
        "leave MuJoCo's own numbers: 100 iterations, 35 of ccd, tolerances of 1e-8 and 1e-6",
        "the solver would end before a wall is found, or has stopped it",
        _solver,
    ),
    Rule(
        "a robot lighter than 0.05 kg",
        "give its geoms their masses, or its bodies",
        "its motors would throw it through a wall in one step",
        _weight,
    ),
    Rule("`size memory` below 1M", "leave it out", "where memory ends, contacts are dropped", _memory),
    Rule(
        "of a geom that collides, the default, the floor or a pair: `solref` softer than 0.1 s or a stiffness of 100, "
        "`solimp` wider than 0.05 m or below 0.01, `margin` or `gap` below 0",
        "leave MuJoCo's own numbers, or harder ones: solref 0.02 1, solimp 0.9 0.95 0.001, margin 0, gap 0",
        "a wall, or the floor, would give way",
        _soft_contacts,
    ),
    Rule(
        "`exclude` of a body and the world",
        "remove it: excludes are for parts of the robot",
        "the floor and walls would not be touched",
        _left_out,
    ),
    Rule(
        "`range` or `stiffness` of a planar base's three joints, equalities and tendons between the base and the world",
        "remove it",
        "what holds the base back keeps it away from walls, and only they may stop it",
        _tethers,
    ),
    Rule(
        "`ref` of a planar base's three joints, `pos` of the hinge",
        "remove it: the base hangs at 0, and turns about its origin; move geoms and sites instead",
        "it would be elsewhere than where it is judged to be",
        _elsewhere,
    ),
    Rule(
        "a hull that begins more than 0.3 m above the floor (1 m with a free joint), or ends below 0.03 m",
        "set the base's pos, or the keyframe, so that it stands on the floor",
        "it would pass over, or below, what stands in its way",
        _heights,
    ),
    Rule(
        "a robot that rises more than 0.5 m by itself, left alone at the start",
        "put its parts on the floor and not into it, margins counted, and leave springs at rest",
        "it would fly over what stands in its way",
        _thrown,
    ),
    Rule(
        "a hull that reaches less than half as far as what is seen of the robot",
        "let the larger geoms collide, or put a cylinder or a box that does around them",
        "what is seen would pass through walls",
        _small_hull,
    ),
)
"""What no engine takes; names that begin as those of Simyard's own parts do are refused before."""


def _other_flags(robot: _Robot) -> Iterator[str]:
    option = robot.model.opt
    for flags, known, prefix, what in (
        (option.disableflags, mujoco.mjtDisableBit, "mjDSBL_", "disable"),
        (option.enableflags, mujoco.mjtEnableBit, "mjENBL_", "enable"),
    ):
        for bit in known.__members__.values():
            if bit.name.startswith(prefix) and flags & bit and bit not in _HARMLESS:
                yield f"option flag {word_of(bit, prefix)} {what}"


def _unlike_earth(robot: _Robot) -> Iterator[str]:
    x, y, z = robot.model.opt.gravity.tolist()
    if robot.base.free and abs(z + _GRAVITY) > _GRAVITY_SLACK:
        yield f"option gravity {_numbers((x, y, z))}: on earth it is 0 0 -9.81"


def _some_motors_off(robot: _Robot) -> Iterator[str]:
    model = robot.model
    for number in range(model.nactuator):
        if model.opt.disableactuator >> int(model.actuator_group[number]) & 1:
            yield f"{actuator_label(model, number)} is disabled by option actuatorgroupdisable"


def _carried(robot: _Robot) -> Iterator[str]:
    for body in np.flatnonzero(robot.model.body_gravcomp).tolist():
        yield f"{body_label(robot.model, body)} has gravcomp {robot.model.body_gravcomp[body]:g}"


def _seen_beyond(robot: _Robot) -> Iterator[str]:
    hull_m, seen_m, widest = _reaches_m(robot)
    if hull_m < _MOSTLY_HULL * seen_m:
        reach = f"reaches {seen_m:.2g} m from its axis, and what collides {hull_m:.2g} m"
        yield f"{geom_label(robot.model, widest)} {reach}: what is beyond passes through walls"


def _jammed(robot: _Robot) -> Iterator[str]:
    """Yields which parts of the robot push each other apart as it stands at the start, the deepest first."""
    model, data = robot.model, robot.at_rest
    mujoco.mj_collision(model, data)
    depths: dict[tuple[int, int], float] = {}
    for contact in data.contact:
        one, other = sorted(int(geom) for geom in contact.geom)
        own = model.body_weldid[model.geom_bodyid[one]] and model.body_weldid[model.geom_bodyid[other]]
        if own and contact.dist < -_JAMMED_M:
            depths[one, other] = max(depths.get((one, other), 0.0), -float(contact.dist))
    for one, other in sorted(depths, key=lambda pair: -depths[pair])[:_SHOWN]:
        overlap = f"overlap by {1000 * depths[one, other]:.0f} mm at the start, and push each other apart"
        yield f"{geom_label(model, one)} and {geom_label(model, other)} {overlap}: move one, or exclude their bodies"
    if len(depths) > _SHOWN:
        yield f"{len(depths) - _SHOWN} more pairs of its geoms overlap at the start"


# They change how fast or how exactly the same is computed.
_HARMLESS = (
    mujoco.mjtDisableBit.mjDSBL_WARMSTART,
    mujoco.mjtDisableBit.mjDSBL_MIDPHASE,
    mujoco.mjtDisableBit.mjDSBL_EULERDAMP,
    mujoco.mjtDisableBit.mjDSBL_AUTORESET,
    mujoco.mjtDisableBit.mjDSBL_NATIVECCD,
    mujoco.mjtDisableBit.mjDSBL_ISLAND,
    mujoco.mjtDisableBit.mjDSBL_MULTICCD,
    mujoco.mjtEnableBit.mjENBL_ENERGY,
    mujoco.mjtEnableBit.mjENBL_FWDINV,
    mujoco.mjtEnableBit.mjENBL_INVDISCRETE,
    mujoco.mjtEnableBit.mjENBL_DIAGEXACT,
)
_GRAVITY, _GRAVITY_SLACK = 9.81, 0.1
_MOSTLY_HULL = 0.85
_JAMMED_M = 1e-3


def _sensing(robot: _Robot) -> Iterator[str]:
    yield from file_sensors(robot.spec, robot.model, robot.at_rest).lines


_STRANGE = (_other_flags, _unlike_earth, _some_motors_off, _carried, _seen_beyond, _jammed, _sensing)
