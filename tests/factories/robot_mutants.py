"""Robots whose files were changed at random, driven blindly into a wall by an engine, and judged by a gate."""

import functools
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from specs.data.episode import CONTROL_S, EpisodeResult
from specs.data.world import World
from specs.field_types import EngineName
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import judge
from tasks.results.gate.rules.rule import GateMaterial
from tasks.results.tables.episode_tables import results_table
from tasks.simulate.application.contract import Body
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.engines.mjx.mjx_engine import mjx_mechanics
from tasks.simulate.engines.mujoco.world_stepper import Stepper, host_robot, world_model
from tasks.simulate.engines.planar.planar_engine import planar_mechanics
from tasks.simulate.geometry.hull_distance import LaneObstacles, hull_distance_m
from tasks.simulate.geometry.obstacles import obstacles, pad_obstacles
from tasks.simulate.lane.control_step import LaneInputs, Mechanics
from tests.factories.episodes import counted, passed, request
from tests.factories.simulations import ROOT_ROBOTS, pen
from tests.repository import ROOT

ROBOTS = (
    *ROOT_ROBOTS,
    *(
        ROOT / f"benchmarks/simulation/robots/{name}.xml"
        for name in ("box-base", "wheeled-base", "carrier", "arm-on-base")
    ),
)
"""Ten robots: those that Simyard brings along, and four more."""

# Full ahead, for as many motors as a robot has.
_AHEAD = {
    "courier": (1.0, 0.0, 0.0),
    "wanderer": (1.0, 1.0, 0.0),
    "turtlebot3": (0.22, 0.0, 0.0),
    "differential": (1.0, 1.0, 0.0),
    "holonomic": (0.8, 0.0, 0.0),
    "skid-steer": (12.0,) * 4,
    "box-base": (0.8, 0.0, 0.0),
    "wheeled-base": (0.8, 0.0, 0.0),
    "carrier": (0.8, 0.0, 0.0),
    "arm-on-base": (0.8, 0.0, 0.0, 0.0, 0.0, 0.0),
}
_START = np.array([2.0, 0.0, 0.0], np.float32)
# The goal is behind the wall, and the shortest way to it leads around.
_GOAL_X_M, _AROUND_M = 3.5, 12.0
_STEPS = 160
_EPISODES = 80
Answer = Literal["refused", "not on this engine", "FAIL", "NOT JUDGED", "crashed", "never there", "PASS"]
"""What came of a mutant; ``refused``: by all engines; ``never there``: a PASS of one that was never at a wall."""
GATE = Gate.model_validate({"collisionRate": {"atMost": 0.05}})


class Mutant(NamedTuple):
    """A changed robot.

    Attributes:
        name: Of the robot that it was.
        text: Its file.
        changes: What was changed.
    """

    name: str
    text: str
    changes: tuple[str, ...]


def mutant(rng: np.random.Generator) -> Mutant:
    """Returns one of the robots with one to three changes."""
    path = ROBOTS[int(rng.integers(len(ROBOTS)))]
    name = path.parent.name if path.stem == "robot" else path.stem
    root = ET.fromstring(path.read_text())  # noqa: S314 - our own file
    changes = tuple(_change(root, rng) for _ in range(int(rng.integers(1, 4))))
    return Mutant(name, ET.tostring(root, encoding="unicode"), changes)


_FLAGS = tuple(
    bit.name.removeprefix(prefix).lower()
    for kind, prefix in ((mujoco.mjtDisableBit, "mjDSBL_"), (mujoco.mjtEnableBit, "mjENBL_"))
    for bit in kind.__members__.values()
    if bit.name.startswith(prefix)
)
_OPTIONS = {
    "gravity": ("0 0 0", "0 0 9.81", "3 0 -9.81", "0 0 -0.5", "0 0 -1.6", "0 4 0"),
    "wind": ("5 0 0", "0 0 9"),
    "density": ("1000", "1.2", "20"),
    "viscosity": ("1", "0.00001"),
    "iterations": ("0", "1", "2"),
    "ls_iterations": ("0", "1"),
    "tolerance": ("1", "0.01", "1e-6"),
    "solver": ("PGS", "CG"),
    "integrator": ("RK4", "implicit", "implicitfast"),
    "cone": ("elliptic",),
    "timestep": ("0.05", "0.025", "0.001"),
    "impratio": ("0.001", "100"),
    "noslip_iterations": ("5",),
    "ccd_iterations": ("0", "1"),
    "ccd_tolerance": ("1", "0.0001"),
    "actuatorgroupdisable": ("0", "1"),
    "o_margin": ("-1",),
    "o_solref": ("10 1",),
}
_GEOM = {
    "contype": ("0", "2"),
    "conaffinity": ("0", "2"),
    "condim": ("1", "4", "6"),
    "margin": ("-0.5", "0.02", "0.3"),
    "gap": ("0.5", "-0.5", "0.01"),
    "solref": ("10 1", "0.02 50", "-1 -1", "0.09 1", "0.005 1", "-5000 -50", "-150 0"),
    "solimp": ("0 0.001 1", "0.0001 0.9 0.5", "0 0.95 0.04", "0.02 0.02 0.001", "0.9 0.9999 0.001"),
    "solmix": ("0", "1000"),
    "priority": ("1", "-1"),
    "friction": ("0", "5"),
    "euler": ("0 1.5708 0", "0 0.3 0"),
    "pos": ("0 0 3", "0 0 -1", "0 0 0.1", "0 0 0.4"),
    "group": ("3",),
    "rgba": ("1 1 1 0",),
}
_JOINT = {
    "range": ("-0.2 0.2", "0 5"),
    "stiffness": ("50", "0.001"),
    "damping": ("100", "0.5"),
    "frictionloss": ("50", "0.1"),
    "armature": ("5", "0.1"),
    "ref": ("1",),
    "axis": ("0 0 1", "1 0 0"),
    "springref": ("2",),
    "solreflimit": ("5 1",),
    "actuatorfrcrange": ("0 0.01", "-1 1"),
}
_EQUALITIES = (
    '<weld body1="base"/>',
    '<connect body1="base" anchor="0 0 0"/>',
    '<joint joint1="x"/>',
    '<weld body1="base" relpose="0 0 3 1 0 0 0"/>',
)
_CONTACTS = (
    '<exclude body1="world" body2="base"/>',
    '<exclude body1="base" body2="simyard/solids"/>',
    '<pair geom1="hull" geom2="hull" gap="1"/>',
    '<pair geom1="bumper" geom2="floor" margin="-1"/>',
)


def _change(root: ET.Element, rng: np.random.Generator) -> str:
    kinds = ("option", "flag", "geom", "default", "joint", "body", "equality", "contact", "size", "compiler", "key")
    kind = kinds[int(rng.choice(len(kinds), p=[0.2, 0.14, 0.22, 0.08, 0.14, 0.06, 0.04, 0.04, 0.02, 0.03, 0.03]))]
    if kind in {"equality", "contact"}:
        text = str(rng.choice(_EQUALITIES if kind == "equality" else _CONTACTS))
        _part(root, kind).append(ET.fromstring(text))  # noqa: S314 - our own
        return text
    if kind == "flag":
        return _set(
            _part(_part(root, "option"), "flag"), str(rng.choice(_FLAGS)), str(rng.choice(["disable", "enable"]))
        )
    if kind == "default":
        return _set_one(_part(_part(root, "default"), "geom"), _GEOM, rng)
    tables = {
        "option": ([_part(root, "option")], _OPTIONS),
        "geom": ([*root.iter("geom")], _GEOM),
        "joint": ([*root.iter("joint"), *root.iter("freejoint")], _JOINT),
        "body": ([*root.iter("body")], {"gravcomp": ("1", "0.4", "5"), "pos": ("0 0 4", "0 0 0.3", "0 0 -0.5")}),
        "size": ([_part(root, "size")], {"memory": ("1K", "100K", "4M"), "nconmax": ("0",), "njmax": ("1",)}),
        "compiler": (
            [_part(root, "compiler")],
            {"fusestatic": ("true",), "discardvisual": ("true",), "settotalmass": ("0.001", "1000")},
        ),
        "key": ([_part(_part(root, "keyframe"), "key")], {"qpos": ("0 0 9", "0 0 4 1 0 0 0 0 0 0 0", "0 0 0")}),
    }
    parts, table = tables[kind]
    return _set_one(parts[int(rng.integers(len(parts)))], table, rng)


def _part(root: ET.Element, tag: str) -> ET.Element:
    found = root.find(tag)
    return ET.SubElement(root, tag) if found is None else found


def _set_one(element: ET.Element, table: dict[str, tuple[str, ...]], rng: np.random.Generator) -> str:
    name = str(rng.choice(sorted(table)))
    return _set(element, name, str(rng.choice(table[name])))


def _set(element: ET.Element, name: str, value: str) -> str:
    element.set(name, value)
    if name == "range":
        element.set("limited", "true")
    return f"{element.tag} {element.get('name', '')} {name}={value}"


def answer_to(each: Mutant, folder: Path, engine: EngineName = "mujoco") -> Answer:
    """Returns what comes of a mutant that drives blindly at a wall, in as many episodes as a gate needs.

    Args:
        each: The robot.
        folder: For its file.
        engine: What drives it.
    """
    path = folder / "robot.xml"
    path.write_text(each.text)
    world = pen(6.0, 1).model_copy(update={"furniture": ()})
    drive = _driven_by_c if engine == "mujoco" else functools.partial(_driven_by_jax, _MECHANICS[engine])
    try:
        drove = drive(path, world, np.array(_AHEAD[each.name], np.float32))
    except RobotRefused as refused:
        return "not on this engine" if re.search("engine refuses|MJX refuses", str(refused)) else "refused"
    if not all(np.isfinite(part).all() for part in (drove.way, drove.pushes_ns)):
        return "crashed"
    measured = _measured(drove)
    results = [measured.model_copy(update={"index": number}) for number in range(_EPISODES)]
    rows = results_table("simb-1", [request(result.index) for result in results], results)
    found = judge(GATE, GateMaterial(counted(results), rows=rows))
    if "NOT JUDGED" in found.sentence:
        return "NOT JUDGED"
    if found.verdict != "PASS":
        return "FAIL"
    return "never there" if measured.min_clearance_m > 0 else "PASS"


class _Drove(NamedTuple):
    """What a robot did in each control step.

    Attributes:
        way: Its poses, the start first.
        pushes_ns: What contacts pushed it with.
        apart_m: How far its hull was from the wall, seen from above.
    """

    way: np.ndarray
    pushes_ns: np.ndarray
    apart_m: np.ndarray


def _driven_by_c(path: Path, world: World, ahead: np.ndarray) -> _Drove:
    robot = host_robot(path)
    stepper = Stepper(robot, [world_model(robot, world)], _START[None], 1)
    controls = np.resize(ahead, (1, robot.actuators))
    poses, pushes = [_START], list[float]()
    for _ in range(_STEPS):
        body, work = stepper.drive(controls, np.ones(1, np.bool_))
        poses.append(body.qpos[0])
        pushes.append(float(work.impulse_ns[0]))
    way = np.array(poses)
    around = _solids(world, robot.hull)
    apart_m = jax.vmap(lambda pose: hull_distance_m(robot.parts, around, pose))(way[1:])
    return _Drove(way, np.array(pushes), np.asarray(apart_m))


def _driven_by_jax(mechanics_of: Callable[[Path], Mechanics], path: Path, world: World, ahead: np.ndarray) -> _Drove:
    mechanics = mechanics_of(path)
    solids = _solids(world, mechanics.hull)
    inputs = LaneInputs(solids, *_NOT_ASKED)
    control = jnp.asarray(np.resize(ahead, mechanics.actuators))

    def step(body: Body, _: None) -> tuple[Body, tuple[jax.Array, ...]]:
        motion = mechanics.drive(inputs, body, control)
        return motion.body, (motion.body.qpos, motion.work.impulse_ns, motion.clearance_m)

    run = jax.jit(lambda body: jax.lax.scan(step, body, None, length=_STEPS)[1])
    poses, pushes, apart_m = map(np.asarray, run(mechanics.first_body(jnp.asarray(_START))))
    return _Drove(np.concatenate([_START[None], poses]), pushes, apart_m)


# What mechanics do not look at: all that LaneInputs must be given beside obstacles.
_NOT_ASKED: tuple[Any, ...] = (None,) * (len(LaneInputs._fields) - len(LaneInputs._field_defaults) - 1)

_MECHANICS: Mapping[EngineName, Callable[[Path], Mechanics]] = {"mjx": mjx_mechanics, "planar": planar_mechanics}


def _solids(world: World, hull: Hull) -> LaneObstacles:
    (solids,) = pad_obstacles([obstacles(world, hull.low_m, hull.high_m)])
    return LaneObstacles(*map(jnp.asarray, solids))


def _measured(drove: _Drove) -> EpisodeResult:
    """Returns what an episode would measure."""
    pushed = drove.pushes_ns > 0
    passed_through = drove.way[:, 0].max() > _GOAL_X_M
    return passed(0).model_copy(
        update={
            "simulated_s": _STEPS * CONTROL_S,
            "path_length_m": float(np.hypot(*np.diff(drove.way[:, :2], axis=0).T).sum()),
            "shortest_path_m": _AROUND_M,
            **({} if passed_through else {"outcome": "Failed", "outcome_reason": "timeout", "goals_reached": 0}),
            "collisions": int(pushed[0]) + int((pushed[1:] & ~pushed[:-1]).sum()),
            "impulse_ns": float(drove.pushes_ns.sum()),
            "max_impulse_ns": float(drove.pushes_ns.max()),
            "min_clearance_m": float(np.where(pushed, drove.apart_m, np.maximum(drove.apart_m, 0.0)).min()),
            "final_x_m": float(drove.way[-1, 0]),
        }
    )
