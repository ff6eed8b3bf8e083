"""The MJX model of one robot with obstacle slots, made once and shared by all lanes and worlds."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Int

from tasks.simulate.obstacles import PARKING_M
from tasks.simulate.quiet_mjx import mjx
from tasks.simulate.robot import CONTROL_S, Hull, RobotRefused, hull_of, read_robot

# Against C MuJoCo with all hundred obstacles: median 1.5e-5 m after 10 s of bumping (physics.md).
BOX_SLOTS = 5
CYLINDER_SLOTS = 3
_NEWTON_ITERATIONS = 2
_LINE_SEARCHES = 4
_SPECK_M = 0.05


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as the engine steps it.

    Attributes:
        model: The robot with its slots parked.
        data: The state that a step starts from, but for what changes.
        host: The same model for C MuJoCo.
        box_slots: Geom ids of the boxes in ``model``.
        cylinder_slots: Geom ids of the capsules that stand for cylinders.
        physics_steps: In one control step.
    """

    model: mjx.Model
    data: mjx.Data
    host: mujoco.MjModel
    box_slots: Int[np.ndarray, "boxes"]
    cylinder_slots: Int[np.ndarray, "cylinders"]
    hull: Hull
    physics_steps: int

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return int(self.host.nu)


def load_robot(path: Path) -> RobotModel:
    """Returns the model of a ``robot.xml``.

    Raises:
        RobotRefused: The robot cannot be represented; says which element, and the remedy.
    """
    spec = read_robot(path)
    hull = hull_of(spec.compile())
    boxes, cylinders = _add_slots(spec)
    _tune(spec)
    host = spec.compile()
    try:
        model = mjx.put_model(host)
        data = mjx.make_data(model)
    except NotImplementedError as exc:
        raise RobotRefused(f"robot.xml: MJX refuses: {exc}") from exc
    return RobotModel(
        model=model,
        data=data,
        host=host,
        box_slots=np.array([host.geom(name).id for name in boxes]),
        cylinder_slots=np.array([host.geom(name).id for name in cylinders]),
        hull=hull,
        physics_steps=round(CONTROL_S / host.opt.timestep),
    )


def collision_bits(spec: mujoco.MjSpec) -> tuple[int, int]:
    """Returns the contype and conaffinity with which an obstacle meets every colliding geom of the robot."""
    contype = conaffinity = 0
    for geom in spec.geoms:
        contype |= geom.conaffinity
        conaffinity |= geom.contype
    return contype, conaffinity


def add_obstacle(spec: mujoco.MjSpec, name: str, kind: mujoco.mjtGeom, bits: tuple[int, int]) -> mujoco.MjsGeom:
    """Returns a new static geom that leaves friction and contact dimension to the robot's own geoms."""
    geom = spec.worldbody.add_geom(name=name, type=kind)
    geom.contype, geom.conaffinity = bits
    geom.condim = 1
    geom.friction = [0.0, 0.0, 0.0]
    return geom


def _add_slots(spec: mujoco.MjSpec) -> tuple[list[str], list[str]]:
    """Adds parked slots; cylinders are capsules, since MJX's cylinders are slow, and equal beside their caps."""
    bits = collision_bits(spec)
    boxes = [f"box-slot-{k}" for k in range(BOX_SLOTS)]
    cylinders = [f"cylinder-slot-{k}" for k in range(CYLINDER_SLOTS)]
    for k, name in enumerate(boxes + cylinders):
        kind = mujoco.mjtGeom.mjGEOM_BOX if name in boxes else mujoco.mjtGeom.mjGEOM_CAPSULE
        geom = add_obstacle(spec, name, kind, bits)
        geom.pos = [PARKING_M + k, PARKING_M, 0.0]
        geom.size = [_SPECK_M] * 3
    return boxes, cylinders


def _tune(spec: mujoco.MjSpec) -> None:
    """Sets the solver as measured: two Newton iterations hold for a hull among eight obstacles."""
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.iterations = _NEWTON_ITERATIONS
    spec.option.ls_iterations = _LINE_SEARCHES
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
