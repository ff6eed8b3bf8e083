"""Pictures a second of processor time, beside MuJoCo's in the same worlds: the tables of ``docs/guide/cameras.md``.

Depth beside ``mj_multiRay``, and colour beside ``mujoco.Renderer`` and, where it can be imported, PyBullet's own
renderer; ``MUJOCO_GL`` says which GL draws. ``--building`` takes what ``simyard world import`` takes, with ``--models``
for what it includes; ``--world`` takes some alone. Pass PyBullet's folder in ``PYTHONPATH``: it needs no GL.
"""

import importlib.util
import itertools
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import mujoco
import numpy as np

import simyard
from benchmarks.harness import machine, markdown, options, show
from benchmarks.simulation.engine_worlds import ROBOT_FILE, bench_world
from benchmarks.worlds.world_templates import read_template
from specs.bundle_files import ColorCameraDeclaration
from specs.data.world import Solid, World, solids, start_pose
from tasks.export.format.mjcf import world_spec
from tasks.render.camera_renderer import CameraPose, CameraRenderer, Light, gl_name, mounted
from tasks.simulate.engines.mujoco.world_stepper import host_robot, world_model
from tasks.simulate.geometry.depth_picture import View, depth_picture, depth_scene, pad_scenes, rays_of
from tasks.worlds.generate import generate_world

_TEMPLATE = "six-room-flat"
_HALLS = {"one hall": 166, "a larger one": 406}
_PICTURES = ((64, 48), (160, 120), (320, 240))
_DEPTH = ((64, 48, 0.0), (64, 48, 0.4), (160, 120, 0.0), (320, 240, 0.0))
_EYES = 32
_MEASURED_S = 1.0


def _worlds(building: str | None, models: Sequence[str]) -> Mapping[str, World]:
    flat = generate_world(read_template(_TEMPLATE), seed=0, generation="flat", floorplan_index=1, interior_index=1)
    found = {"flat of six rooms": flat, **{name: bench_world(0, count) for name, count in _HALLS.items()}}
    if building is not None:
        with tempfile.TemporaryDirectory() as store:
            found["own building"] = simyard.world_import(building, models=models, store=f"file://{store}").document
    return found


def _poses(world: World) -> np.ndarray:
    """Returns places around where a robot starts, and what way it looks there: x, y, yaw."""
    start = start_pose(world)
    off = np.random.default_rng(0).uniform((-1.0, -1.0, -np.pi), (1.0, 1.0, np.pi), (_EYES, 3))
    return off + np.array([start.x_m, start.y_m, 0.0])


def _rate(pictures: int, take: Callable[[int], object]) -> str:
    """Returns pictures a second of processor time, the first call apart; at least three calls count."""
    take(0)
    done, began_s, took_s = 0, time.process_time(), 0.0
    while took_s < _MEASURED_S or done < 3:
        done += 1
        take(done % _EYES)
        took_s = time.process_time() - began_s
    rate = pictures * done / took_s
    return f"{rate:,.0f}" if rate > 10.0 else f"{rate:.1f}"


def _columns(world: World, view: View, eyes: np.ndarray) -> str:
    scene = pad_scenes([depth_scene(world)])[0]
    taken = jax.jit(lambda seen, each: jax.lax.map(lambda eye: depth_picture(seen, eye, view), each))
    return _rate(len(eyes), lambda _: taken(scene, eyes).block_until_ready())


def _rays(world: World, view: View, eyes: np.ndarray) -> str:
    model = world_model(host_robot(ROBOT_FILE), world)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ahead, left, up = (each.astype(np.float64).ravel() for each in np.broadcast_arrays(*rays_of(view)))
    lengths, base = np.sqrt(ahead**2 + left**2 + up**2), int(model.jnt_bodyid[0])
    geoms, found = np.empty(len(ahead), np.int32), np.empty(len(ahead))

    def take(at: int) -> None:
        cos, sin = np.cos(eyes[at, 3]), np.sin(eyes[at, 3])
        rays = np.stack([cos * ahead - sin * left, sin * ahead + cos * left, up], axis=1) / lengths[:, None]
        eye, far_m = eyes[at, :3].astype(np.float64), 2.0 * view.range_m
        mujoco.mj_multiRay(model, data, eye, rays.ravel(), None, 1, base, geoms, found, None, len(ahead), far_m)

    return _rate(1, take)


def _mujoco(world: World, camera: ColorCameraDeclaration, poses: Sequence[CameraPose], *, lean: bool) -> str:
    """Returns the rate of MuJoCo's own renderer: as it comes, or without multisampling and shadows."""
    spec = world_spec(world, ceiling=True)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.columns, camera.rows
    body = spec.worldbody.add_body(name="eye", mocap=True)
    body.add_camera(name="eye", fovy=_fovy_deg(camera))
    if lean:
        spec.visual.quality.offsamples = 0
    model = spec.compile()
    data = mujoco.MjData(model)

    def take(at: int) -> None:
        pose = poses[at]
        turn = np.stack([np.cross(pose.ahead, pose.up), pose.up, -pose.ahead], axis=1)
        mujoco.mju_mat2Quat(data.mocap_quat[0], turn.ravel())
        data.mocap_pos[0] = pose.position_m
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, "eye")
        if lean:
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        renderer.render()

    with mujoco.Renderer(model, camera.rows, camera.columns) as renderer:
        return _rate(1, take)


def _bullet() -> Any | None:  # noqa: ANN401 - a module without types
    """Returns PyBullet, if there is one."""
    return importlib.import_module("pybullet") if importlib.util.find_spec("pybullet") else None


def _corners(solid: Solid) -> tuple[list[list[float]], list[int]]:
    """Returns a prism's corners, lower ones first, and three of them for each triangle."""
    outline, half_m = solid.outline_m or (), solid.half_extents_m[2]
    many = len(outline)
    sides = [(at, (at + 1) % many) for at in range(many)]
    walls = [[one, other, many + other, one, many + other, many + one] for one, other in sides]
    ends = [[0, at + 1, at, many, many + at, many + at + 1] for at in range(1, many - 1)]
    return [[*each, z_m] for z_m in (-half_m, half_m) for each in outline], [
        at for each in (*walls, *ends) for at in each
    ]


def _add_to_bullet(bullet: Any, solid: Solid) -> None:  # noqa: ANN401 - a module without types
    half_m = solid.half_extents_m
    shape: dict[str, Any] = {"shapeType": bullet.GEOM_BOX, "halfExtents": half_m}
    if solid.shape == "cylinder":
        shape = {"shapeType": bullet.GEOM_CYLINDER, "radius": half_m[0], "length": 2.0 * half_m[2]}
    elif solid.shape == "prism":
        vertices, triangles = _corners(solid)
        shape = {"shapeType": bullet.GEOM_MESH, "vertices": vertices, "indices": triangles}
    look = bullet.createVisualShape(**shape, rgbaColor=[*solid.color, 1.0])
    turn = bullet.getQuaternionFromEuler([0.0, 0.0, solid.yaw_rad])
    bullet.createMultiBody(0.0, -1, look, solid.center_m, turn)


def _in_bullet(bullet: Any, world: World, camera: ColorCameraDeclaration, poses: Sequence[CameraPose]) -> str:  # noqa: ANN401
    """Returns the rate of PyBullet's renderer, which gives colour, depth and solids at once."""
    bullet.connect(bullet.DIRECT)
    for each in solids(world):
        _add_to_bullet(bullet, each)
    area, high_m = world.footprint, world.ceiling_height_m
    middle = [(area.x_min_m + area.x_max_m) / 2.0, (area.y_min_m + area.y_max_m) / 2.0]
    half = [(area.x_max_m - area.x_min_m) / 2.0, (area.y_max_m - area.y_min_m) / 2.0]
    for z_m in (-0.05, high_m + 0.05):
        look = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=[*half, 0.05], rgbaColor=[0.6, 0.6, 0.6, 1.0])
        bullet.createMultiBody(0.0, -1, look, [*middle, z_m])
    lens = bullet.computeProjectionMatrixFOV(_fovy_deg(camera), camera.columns / camera.rows, 0.02, 100.0)

    def take(at: int) -> None:
        eye, ahead, up = poses[at]
        seen = bullet.computeViewMatrix(eye.tolist(), (eye + ahead).tolist(), up.tolist())
        bullet.getCameraImage(camera.columns, camera.rows, seen, lens, renderer=bullet.ER_TINY_RENDERER)

    try:
        return _rate(1, take)
    finally:
        bullet.disconnect()


def _fovy_deg(camera: ColorCameraDeclaration) -> float:
    return 2.0 * float(np.degrees(np.arctan(camera.rows / camera.columns * np.tan(camera.fov_rad / 2.0))))


def _colors(world: World, camera: ColorCameraDeclaration, bullet: Any | None) -> list[str]:  # noqa: ANN401
    poses = [mounted(camera, *pose) for pose in _poses(world).tolist()]
    ours = CameraRenderer(world, camera)
    rates = [_rate(1, lambda at: ours.color(poses[at], Light())), _rate(1, lambda at: ours.depth_and_solids(poses[at]))]
    ours.close()
    rates += [_mujoco(world, camera, poses, lean=lean) for lean in (False, True)]
    return rates if bullet is None else [*rates, _in_bullet(bullet, world, camera, poses)]


def main() -> None:
    """Measures, and prints the tables or puts them into a document."""
    parser = options(__doc__)
    parser.add_argument("--building", help="a world of one's own, to be looked at as well")
    parser.add_argument("--models", action="append", default=[], help="a folder of what it includes")
    parser.add_argument("--world", action="append", help="one of the table's, alone")
    arguments = parser.parse_args()
    worlds = _worlds(arguments.building, arguments.models)
    worlds = {name: worlds[name] for name in arguments.world or worlds}
    bullet = _bullet()
    rows = [["world", "solids", "picture", "pitch", "Simyard", "`mj_multiRay`"]]
    for name, world in worlds.items():
        x_m, y_m, yaw_rad = _poses(world).T
        eyes = np.stack([x_m, y_m, np.full(_EYES, 0.3), yaw_rad], axis=1).astype(np.float32)
        for columns, lines, pitch_rad in _DEPTH:
            view = View(columns, lines, 1.2, pitch_rad, 10.0)
            rates = [each(world, view, eyes) for each in (_columns, _rays)]
            rows.append([name, f"{len(solids(world))}", f"{columns}x{lines}", f"{pitch_rad:g}", *rates])
    show("cameras", f"{markdown(rows)}\n\nPictures a second of processor time, on {machine()}", arguments.document)
    context = mujoco.GLContext(640, 480)
    heads = [
        "world",
        "solids",
        "picture",
        "colour",
        "depth and solids",
        "`mujoco.Renderer`",
        "the same without shadows",
    ]
    rows = [heads if bullet is None else [*heads, "PyBullet"]]
    for (name, world), (columns, lines) in itertools.product(worlds.items(), _PICTURES):
        context.make_current()
        camera = ColorCameraDeclaration(columns=columns, rows=lines)
        rows.append([name, f"{len(solids(world))}", f"{columns}x{lines}", *_colors(world, camera, bullet)])
    context.make_current()
    text = f"{markdown(rows)}\n\nPictures a second of processor time, with {gl_name()}, on {machine()}"
    show("color cameras", text, arguments.document)


if __name__ == "__main__":
    main()
