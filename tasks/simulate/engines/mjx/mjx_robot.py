"""The MJX model of one robot with obstacle slots, made once and shared by all lanes and worlds.

The slots are the engine's window: the nearest obstacles are written into them.
"""

import functools
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int

from specs.data.episode import CONTROL_S
from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from specs.data.world import MOST_CORNERS
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import (
    Base,
    Hull,
    add_obstacle,
    add_prism_mesh,
    base_of,
    collision_bits,
    compile_robot,
    hull_of,
    rest_position,
)
from tasks.simulate.engines.mjx.mjx_limits import refuse_what_mjx_lacks, with_stand_ins
from tasks.simulate.geometry.hull_distance import LaneObstacles, Prisms, to_obstacles_m
from tasks.simulate.geometry.hull_outline import HullPart, hull_parts
from tasks.simulate.geometry.obstacles import PARKING_M

# Without warp, which only its GPU backend needs, MJX prints two lines to standard output when it is imported.
with redirect_stdout(StringIO()):
    from mujoco import mjx
    from mujoco.mjx._src.types import ConvexMesh  # MJX has no public way to its meshes

__all__ = ["mjx"]


# Against C MuJoCo with all hundred obstacles: median 1.5e-5 m after 10 s of bumping
# (docs/reference/physics.md, section 3).
BOX_SLOTS = 5
CYLINDER_SLOTS = 3
PRISM_SLOTS = 3
PERSON_SLOTS = 3
SLOTS = (BOX_SLOTS, CYLINDER_SLOTS, PRISM_SLOTS)
_NEWTON_ITERATIONS = 2
_LINE_SEARCHES = 4
_SPECK_M = 0.05
# Beside what is touched in exact numbers: for single precision, and for the places within a step that RK4 looks at.
_SLACK_M, _RK4_SLACK_M = 1e-4, 0.05
# Also on a GPU, where MJX may prefer Warp: it keeps forces and contacts elsewhere, and knows no window of obstacles.
_IMPLEMENTATION = "jax"


@dataclass(frozen=True, eq=False)
class FreeModel:
    """A robot without any obstacles, on its floor if it stands on one.

    Attributes:
        geoms: Ids of those that obstacles would touch.
        reach_m: How far from its middle each could touch one.
    """

    model: mjx.Model
    data: mjx.Data
    geoms: Int[np.ndarray, "geoms"]
    reach_m: Float32[np.ndarray, "geoms"]


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as the engine steps it.

    Attributes:
        model: The robot with its slots parked.
        data: The state that a step starts from, but for what changes.
        host: The same model for C MuJoCo.
        free: The robot where no obstacle is near.
        base: How it stands in the world.
        rest: Its coordinates before it is placed at a start.
        rest_act: Its actuators' activations then.
        box_slots: Geom ids of the boxes in ``model``.
        cylinder_slots: Geom ids of the capsules that stand for cylinders.
        prism_slots: Geom ids of the meshes that become prisms; none in a program without any.
        person_slots: Geom ids of the capsules that stand for people; none in a program without any.
        parts: Of the hull, for its clearance.
        physics_steps: In one control step.
    """

    model: mjx.Model
    data: mjx.Data
    host: mujoco.MjModel
    free: FreeModel
    base: Base
    rest: Float32[np.ndarray, "coordinates"]
    rest_act: Float32[np.ndarray, "activations"]
    box_slots: Int[np.ndarray, "boxes"]
    cylinder_slots: Int[np.ndarray, "cylinders"]
    prism_slots: Int[np.ndarray, "prisms"]
    person_slots: Int[np.ndarray, "people"]
    hull: Hull
    parts: tuple[HullPart, ...]
    physics_steps: int

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return int(self.host.nu)

    @property
    def slots(self) -> Int[np.ndarray, "slots"]:
        """Returns the geom ids of all slots of solids."""
        return np.concatenate([self.box_slots, self.cylinder_slots, self.prism_slots])

    @property
    def only_obstacles_hold(self) -> bool:
        """Returns whether nothing but solids can hold the base: no floor, people, limits or friction."""
        host = self.host
        held = host.jnt_limited.any() or host.dof_frictionloss.any() or host.neq or host.ntendon
        return not (self.base.free or self.base.articulated or held or len(self.person_slots))


def load_robot(path: Path, *, prisms: bool = False, people: bool = False) -> RobotModel:
    """Returns the model of a ``robot.xml``.

    Args:
        path: Of the file.
        prisms: Whether there are slots for prisms: where none is near they cost time all the same.
        people: Likewise for people.

    Raises:
        RobotRefused: The robot cannot be represented; says which element, and the remedy.
    """
    spec = read_robot_mjcf(path)
    alone = compile_robot(spec)
    base, hull = base_of(alone), hull_of(alone)
    refuse_what_mjx_lacks(with_stand_ins(spec))
    _tune(spec, alone, base)
    free_host = compile_robot(spec)
    boxes, cylinders, wedges = _add_slots(spec, PRISM_SLOTS if prisms else 0)
    alive = _add_person_slots(spec, PERSON_SLOTS if people else 0)
    host = compile_robot(spec)
    (model, data), free = _put(host), _put(free_host)
    return RobotModel(
        model=model,
        data=data,
        host=host,
        free=FreeModel(*free, *_reach(free_host, host)),
        base=base,
        rest=rest_position(host).astype(np.float32),
        rest_act=np.array(host.key_act[0] if host.nkey else np.zeros(host.na), np.float32),
        box_slots=np.array([host.geom(name).id for name in boxes]),
        cylinder_slots=np.array([host.geom(name).id for name in cylinders]),
        prism_slots=np.array([host.geom(name).id for name in wedges], int),
        person_slots=np.array([host.geom(name).id for name in alive], int),
        hull=hull,
        parts=hull_parts(alone),
        physics_steps=round(CONTROL_S / host.opt.timestep),
    )


def _put(host: mujoco.MjModel) -> tuple[mjx.Model, mjx.Data]:
    try:
        model = mjx.put_model(host, impl=_IMPLEMENTATION)
        return model, mjx.make_data(model)
    except NotImplementedError as exc:
        raise RobotRefused(f"robot.xml: MJX refuses: {exc}: set engine: mujoco") from exc


def _reach(
    alone: mujoco.MjModel, among: mujoco.MjModel
) -> tuple[Int[np.ndarray, "geoms"], Float32[np.ndarray, "geoms"]]:
    """Returns the geoms that an obstacle could touch, and how far from its middle each of them could.

    Args:
        alone: The robot.
        among: The same with slots, whose margins a default of the robot's file may set.
    """
    moving = alone.body_weldid[alone.geom_bodyid] != 0
    geoms = np.flatnonzero(moving & ((alone.geom_contype != 0) | (alone.geom_conaffinity != 0)))
    endless = alone.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_PLANE
    slack_m = _RK4_SLACK_M if alone.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else _SLACK_M
    margins_m = alone.geom_margin[geoms] + among.geom_margin.max() + slack_m
    return geoms, np.where(endless, np.inf, alone.geom_rbound[geoms] + margins_m).astype(np.float32)


def _add_slots(spec: mujoco.MjSpec, prism_slots: int) -> tuple[list[str], list[str], list[str]]:
    """Adds parked slots; cylinders are capsules, since MJX's cylinders are slow, and equal beside their caps."""
    bits = collision_bits(spec)
    boxes = [f"box-slot-{k}" for k in range(BOX_SLOTS)]
    cylinders = [f"cylinder-slot-{k}" for k in range(CYLINDER_SLOTS)]
    wedges = [f"prism-slot-{k}" for k in range(prism_slots)]
    for k, name in enumerate(boxes + cylinders + wedges):
        kind = mujoco.mjtGeom.mjGEOM_BOX if name in boxes else mujoco.mjtGeom.mjGEOM_CAPSULE
        geom = add_obstacle(spec, name, mujoco.mjtGeom.mjGEOM_MESH if name in wedges else kind, bits)
        geom.pos = [PARKING_M + k, PARKING_M, 0.0]
        geom.size = [_SPECK_M] * 3
        if name in wedges:
            turns = 2 * np.pi * np.arange(MOST_CORNERS) / MOST_CORNERS
            add_prism_mesh(spec, name, _SPECK_M * np.stack([np.cos(turns), np.sin(turns)], axis=1), _SPECK_M)
            geom.meshname = name
    return boxes, cylinders, wedges


def _add_person_slots(spec: mujoco.MjSpec, count: int) -> list[str]:
    """Adds parked slots for people, as those for cylinders are."""
    bits, half_m, names = collision_bits(spec), PERSON_HEIGHT_M / 2, [f"person-slot-{k}" for k in range(count)]
    for k, name in enumerate(names):
        geom = add_obstacle(spec, name, mujoco.mjtGeom.mjGEOM_CAPSULE, bits)
        geom.pos, geom.size = [PARKING_M + k, -PARKING_M, half_m], [PERSON_RADIUS_M, half_m, 0.0]
    return names


def _tune(spec: mujoco.MjSpec, alone: mujoco.MjModel, base: Base) -> None:
    """Sets the solver as measured: two Newton iterations hold for a hull among eight obstacles.

    All of MuJoCo's solvers look for the same forces; Newton's is the one that MJX is fastest with.
    """
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    if not (base.free or base.articulated):
        spec.option.iterations = _NEWTON_ITERATIONS
        spec.option.ls_iterations = _LINE_SEARCHES
    if not alone.dof_damping.any():
        # There is nothing to damp implicitly, and MJX need not factor a matrix for it.
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


# MJX pays for every geom pair at every step, near or far. Of an apartment's hundred solids only those within reach of
# the next control step can matter, so each lane's model holds slots for those, refilled at each control step.
def nearest_obstacles(
    obstacles: LaneObstacles, center_m: Float[jax.Array, "2"]
) -> tuple[LaneObstacles, Float[jax.Array, ""]]:
    """Returns as many of each kind as there are slots, those nearest to a point, and how near the nearest is.

    Args:
        obstacles: Of the world, in the hull's band of heights.
        center_m: The point (x, y), seen from above.
    """
    apart_m = to_obstacles_m(obstacles, center_m)
    window = [
        kind[jax.lax.top_k(-away_m, slots)[1]] for kind, away_m, slots in zip(obstacles, apart_m, SLOTS, strict=False)
    ]
    nearest_m = functools.reduce(jnp.minimum, [away_m.min() for away_m in apart_m])
    return LaneObstacles(*window, *obstacles[len(window) :]), nearest_m


def nearest_people(
    people_m: Float[jax.Array, "people 2"], center_m: Float[jax.Array, "2"]
) -> tuple[Float[jax.Array, "slots 2"], Float[jax.Array, ""]]:
    """Returns as many people as there are slots, those nearest to a point, and how near the nearest is."""
    away_m = jnp.sqrt(jnp.sum((people_m - center_m) ** 2, axis=1)) - PERSON_RADIUS_M
    return people_m[jax.lax.top_k(-away_m, PERSON_SLOTS)[1]], away_m.min()


def with_window(
    robot: RobotModel, window: LaneObstacles, people_m: Float[jax.Array, "slots 2"] | None = None
) -> mjx.Model:
    """Returns the robot's model with the window's obstacles in its slots, and people where they stand (x, y)."""
    base, box, cylinder = robot.model, robot.box_slots, robot.cylinder_slots
    if len(robot.prism_slots):
        base = _with_prisms(robot, window.prisms)
    half_yaw = jnp.arctan2(window.boxes[:, 7], window.boxes[:, 6]) / 2
    flat = jnp.zeros_like(half_yaw)
    turn = jnp.stack([jnp.cos(half_yaw), flat, flat, jnp.sin(half_yaw)], axis=-1)
    places = base.geom_pos.at[box].set(window.boxes[:, :3]).at[cylinder].set(window.cylinders[:, :3])
    if people_m is not None:
        places = places.at[robot.person_slots, :2].set(people_m)
    return base.replace(
        geom_pos=places,
        geom_quat=base.geom_quat.at[box].set(turn),
        geom_size=base.geom_size.at[box].set(window.boxes[:, 3:6]).at[cylinder, :2].set(window.cylinders[:, 3:5]),
    )


def _with_prisms(robot: RobotModel, prisms: Prisms) -> mjx.Model:
    base, meshes = robot.model, list(robot.model._impl.mesh_convex)  # noqa: SLF001 - MJX has no public way to its meshes
    corners = prisms[:, 4:].reshape(-1, MOST_CORNERS, 2)
    # MJX takes a mesh's origin for a place inside it.
    middle = corners.mean(axis=1)
    for slot, mesh in enumerate(robot.host.geom_dataid[robot.prism_slots].tolist()):
        meshes[mesh] = _prism_mesh(corners[slot] - middle[slot], prisms[slot, 3])
    upright = jnp.array([1.0, 0.0, 0.0, 0.0])
    return base.tree_replace(
        {
            "geom_pos": base.geom_pos.at[robot.prism_slots].set(prisms[:, :3].at[:, :2].add(middle)),
            "geom_quat": base.geom_quat.at[robot.prism_slots].set(upright),
            "_impl.mesh_convex": tuple(meshes),
        }
    )


_RING = np.arange(MOST_CORNERS)
_NEXT = np.roll(_RING, -1)
# Corners of the ends' outlines in a prism's mesh: those at its bottom, then those at its top.
_ENDS = np.stack([_RING[::-1], _RING + MOST_CORNERS])
# Upright edges come first: of those that are equally near, MJX takes the first one.
_EDGES = np.concatenate([np.stack(each, axis=1) for each in (
    (_RING, _RING + MOST_CORNERS), (_RING, _NEXT), (_RING + MOST_CORNERS, _NEXT + MOST_CORNERS)
)])  # fmt: skip


def _prism_mesh(corners: Float[jax.Array, "corners 2"], half_height: Float[jax.Array, ""]) -> ConvexMesh:
    """Returns a prism as MJX collides it; a side without a length is the last one again."""
    heights = jnp.repeat(jnp.stack([-half_height, half_height]), MOST_CORNERS)
    vertices = jnp.concatenate([jnp.tile(corners, (2, 1)), heights[:, None]], axis=1)
    along = corners[_NEXT] - corners
    length = jnp.sqrt(jnp.sum(along**2, axis=1))
    side = jnp.where(length > 0.0, _RING, MOST_CORNERS - 1)
    outward = jnp.stack([along[:, 1], -along[:, 0], jnp.zeros(MOST_CORNERS)], axis=1) / length[:, None]
    outward = outward[side]
    quads = np.stack([_RING, _NEXT, _NEXT + MOST_CORNERS, _RING + MOST_CORNERS], axis=1)
    sides = jnp.pad(vertices[quads][side], ((0, 0), (0, MOST_CORNERS - 4), (0, 0)), "edge")
    up = jnp.tile(jnp.array([0.0, 0.0, 1.0]), (MOST_CORNERS, 1))
    beside = [(outward[np.roll(_RING, 1)], outward), (outward, -up), (outward, up)]
    return ConvexMesh(
        vert=vertices,
        face=jnp.concatenate([sides, vertices[_ENDS]]),
        face_normal=jnp.concatenate([outward, -up[:1], up[:1]]),
        edge=jnp.asarray(_EDGES),
        edge_face_normal=jnp.concatenate([jnp.stack(each, axis=1) for each in beside]),
    )
