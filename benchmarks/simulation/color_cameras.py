"""Colour pictures a second of processor time, beside ``mujoco.Renderer`` in the same world: ``docs/guide/cameras.md``.

``MUJOCO_GL`` says which GL draws, as ``MUJOCO_GL=osmesa python -m benchmarks.simulation.color_cameras``.
"""

import time
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from benchmarks.harness import machine, markdown, options, show
from benchmarks.simulation.engine_worlds import bench_world
from benchmarks.worlds.world_templates import read_template
from specs.bundle_files import ColorCameraDeclaration
from specs.data.world import World, solids
from tasks.export.format.mjcf import world_spec
from tasks.render.camera_renderer import CameraPose, CameraRenderer, Light, gl_name, mounted
from tasks.worlds.generate import generate_world

_TEMPLATE = "six-room-flat"
_SOLIDS = (166, 406)
_PICTURES = ((64, 48), (160, 120), (320, 240))
_EYES = 32
_MEASURED_S = 1.0


def _rate(take: Callable[[CameraPose], object], poses: Sequence[CameraPose]) -> str:
    """Returns pictures a second of processor time, the first apart; at least three are taken."""
    take(poses[0])
    done, began_s = 0, time.process_time()
    while time.process_time() - began_s < _MEASURED_S or done < 3:
        take(poses[done % len(poses)])
        done += 1
    rate = done / (time.process_time() - began_s)
    return f"{rate:,.0f}" if rate > 10.0 else f"{rate:.1f}"


def _theirs(world: World, camera: ColorCameraDeclaration, poses: Sequence[CameraPose], *, lean: bool) -> str:
    """Returns the rate of MuJoCo's own renderer: as it comes, or without multisampling and shadows."""
    spec = world_spec(world, ceiling=True)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.columns, camera.rows
    body = spec.worldbody.add_body(name="eye", mocap=True)
    body.add_camera(name="eye", fovy=2.0 * float(np.degrees(np.arctan(camera.rows / camera.columns * np.tan(0.6)))))
    if lean:
        spec.visual.quality.offsamples = 0
    model = spec.compile()
    data = mujoco.MjData(model)

    def take(pose: CameraPose) -> None:
        turn = np.stack([np.cross(pose.ahead, pose.up), pose.up, -pose.ahead], axis=1)
        mujoco.mju_mat2Quat(data.mocap_quat[0], turn.ravel())
        data.mocap_pos[0] = pose.position_m
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, "eye")
        if lean:
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        renderer.render()

    with mujoco.Renderer(model, camera.rows, camera.columns) as renderer:
        return _rate(take, poses)


def _row(name: str, world: World, camera: ColorCameraDeclaration, poses: Sequence[CameraPose]) -> list[str]:
    ours = CameraRenderer(world, camera)
    rates = [_rate(lambda pose: ours.color(pose, Light()), poses), _rate(ours.depth_and_solids, poses)]
    ours.close()
    rates += [_theirs(world, camera, poses, lean=lean) for lean in (False, True)]
    return [name, f"{len(solids(world))}", f"{camera.columns}x{camera.rows}", *rates]


def main() -> None:
    """Measures, and prints the table or puts it into a document."""
    arguments = options(__doc__).parse_args()
    flat = generate_world(read_template(_TEMPLATE), seed=0, generation="flat", floorplan_index=1, interior_index=1)
    worlds = {"flat of six rooms": flat}
    worlds |= {"one hall": bench_world(0, _SOLIDS[0]), "a larger one": bench_world(0, _SOLIDS[1])}
    context = mujoco.GLContext(640, 480)
    context.make_current()
    head = ["world", "solids", "picture", "colour", "depth and solids", "`mujoco.Renderer`", "the same without shadows"]
    rows = [head]
    for name, world in worlds.items():
        for columns, lines in _PICTURES:
            camera = ColorCameraDeclaration(columns=columns, rows=lines)
            drawn = np.random.default_rng(0).uniform((-1.0, -1.0, -np.pi), (1.0, 1.0, np.pi), (_EYES, 3)).tolist()
            context.make_current()
            rows.append(_row(name, world, camera, [mounted(camera, *pose) for pose in drawn]))
            print(rows[-1], flush=True)
    context.make_current()
    text = f"{markdown(rows)}\n\nPictures a second of processor time, with {gl_name()}, on {machine()}"
    show("color cameras", text, arguments.document)


if __name__ == "__main__":
    main()
