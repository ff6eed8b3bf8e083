"""What MJX cannot represent: each culprit by name, with the remedy."""

from collections.abc import Iterator

import mujoco

from tasks.simulate.application.part_names import geom_label, word_of
from tasks.simulate.refusal import RobotRefused

_ELSEWHERE = "or set engine: mujoco"
# Obstacles are boxes, and capsules in place of cylinders.
_AMONG_BOXES = (
    mujoco.mjtGeom.mjGEOM_PLANE,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)
_INTEGRATORS = (
    mujoco.mjtIntegrator.mjINT_EULER,
    mujoco.mjtIntegrator.mjINT_RK4,
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
)


def refuse_what_mjx_lacks(model: mujoco.MjModel) -> None:
    """Accepts a robot that MJX can step, as far as can be said without asking MJX itself.

    Raises:
        RobotRefused: It cannot; names every culprit.
    """
    faults = [f"robot.xml: {fault}, {_ELSEWHERE}" for check in (_options, _geoms) for fault in check(model)]
    if faults:
        raise RobotRefused("the mjx engine refuses the robot:\n  " + "\n  ".join(faults))


def _options(model: mujoco.MjModel) -> Iterator[str]:
    if model.opt.integrator not in _INTEGRATORS:
        found = word_of(mujoco.mjtIntegrator(model.opt.integrator), "mjINT_")
        yield f"option integrator {found}: MJX steps Euler, RK4 and implicitfast: set one of them"
    frictionless = [geom for geom in _colliding(model) if model.geom_condim[geom] == 1]
    if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC and frictionless:
        name = geom_label(model, frictionless[0])
        yield f"option cone elliptic: MJX has no frictionless contacts then, as of {name}: set pyramidal"


def _geoms(model: mujoco.MjModel) -> Iterator[str]:
    for geom in _colliding(model):
        kind, name = mujoco.mjtGeom(model.geom_type[geom]), geom_label(model, geom)
        if kind not in _AMONG_BOXES:
            word = word_of(kind, "mjGEOM_")
            yield f"{name}: MJX cannot collide a {word} with boxes: use a sphere, a capsule, a box or a mesh"
        if model.geom_margin[geom] and kind == mujoco.mjtGeom.mjGEOM_MESH:
            yield f"{name}: margin {model.geom_margin[geom]:g}: MJX gives meshes none: set 0"


def _colliding(model: mujoco.MjModel) -> list[int]:
    return [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]
