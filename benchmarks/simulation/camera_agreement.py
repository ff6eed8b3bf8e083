"""Depths of the compiled step, pixel by pixel, beside MuJoCo's rays and the GL's: a table of docs/guide/cameras.md.

``MUJOCO_GL`` says which GL draws, as ``MUJOCO_GL=osmesa python -m benchmarks.simulation.camera_agreement``.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import jax
import mujoco
import numpy as np
import shapely

from benchmarks.harness import markdown, options, show
from benchmarks.simulation.engine_worlds import ROBOT_FILE
from benchmarks.worlds.world_templates import read_template
from specs.bundle_files import ColorCameraDeclaration
from specs.data.world import Rectangle, World, corners_m, solids
from tasks.render.camera_renderer import CameraRenderer, gl_name, mounted
from tasks.simulate.engines.mujoco.world_stepper import host_robot, world_model
from tasks.simulate.geometry.depth_picture import View, depth_picture, depth_scene, pad_scenes, rays_of
from tasks.worlds.generate import generate_world

_TEMPLATE, _WORLDS, _PICTURES, _HEIGHT_M = "six-room-flat", 10, 1_000, 0.3
_FAR_M, _FREE_M, _WRONG_M = 10.0, 0.02, 1e-3
_PITCHES_RAD = (0.0, 0.4, -0.3)
# An inverse depth bends by less along any plane.
_BEND = 1e-3

Depths = np.ndarray
"""Of pictures, rows and columns, in metres."""


class _Found(NamedTuple):
    """Pixels that were compared: all, those at edges, and of each of both how many are too far off; and how far."""

    pixels: int = 0
    at_edges: int = 0
    wrong_at_edges: int = 0
    wrong: int = 0
    most_m: float = 0.0

    def and_also(self, other: "_Found") -> "_Found":
        """Returns both together."""
        return _Found(
            self.pixels + other.pixels,
            self.at_edges + other.at_edges,
            self.wrong_at_edges + other.wrong_at_edges,
            self.wrong + other.wrong,
            max(self.most_m, other.most_m),
        )


def _edges(depth_m: Depths) -> np.ndarray:
    """Returns which pixels do not lie in one plane with those beside, above and below them."""
    inverse = np.pad(1.0 / np.maximum(depth_m, _WRONG_M), ((0, 0), (1, 1), (1, 1)), mode="edge")
    middle = inverse[:, 1:-1, 1:-1]
    bends = [
        np.abs(inverse[:, 1:-1, :-2] + inverse[:, 1:-1, 2:] - 2 * middle),
        np.abs(inverse[:, :-2, 1:-1] + inverse[:, 2:, 1:-1] - 2 * middle),
    ]
    return np.maximum(*bends) > _BEND * middle


def _compared(ours: Depths, theirs: Depths) -> _Found:
    off_m, edges = np.abs(ours - theirs), _edges(ours)
    wrong = off_m > _WRONG_M
    at_edges, wrong_at_edges, others = (int(each.sum()) for each in (edges, wrong & edges, wrong & ~edges))
    return _Found(off_m.size, at_edges, wrong_at_edges, others, float(off_m[~edges].max()))


def _ours(world: World, view: View, eyes: np.ndarray) -> Depths:
    taken = jax.jit(lambda seen, each: jax.lax.map(lambda eye: depth_picture(seen, eye, view), each))
    return np.asarray(taken(pad_scenes([depth_scene(world)])[0], eyes))


def _by_rays(world: World, view: View, eyes: np.ndarray, ours: Depths) -> Depths:
    """Returns what MuJoCo's rays measure: all at once, and one by one where that is not what ``ours`` are.

    ``mj_multiRay`` passes through some walls that are a few centimetres away, which ``mj_ray`` meets.
    """
    stage = host_robot(ROBOT_FILE)
    stage.spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50.0, 50.0, 0.1])
    above_m = [0.0, 0.0, world.ceiling_height_m + 0.5]
    stage.spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[50.0, 50.0, 0.5], pos=above_m)
    model = world_model(stage, world)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ahead, left, up = (each.astype(np.float64).ravel() for each in np.broadcast_arrays(*rays_of(view)))
    lengths, base, count = np.sqrt(ahead**2 + left**2 + up**2), int(model.jnt_bodyid[0]), len(ahead)
    geoms, found, depths = np.empty(count, np.int32), np.empty(count), list[np.ndarray]()
    for eye, seen_m in zip(eyes.astype(np.float64), ours, strict=True):
        cos, sin = np.cos(eye[3]), np.sin(eye[3])
        rays = np.stack([cos * ahead - sin * left, sin * ahead + cos * left, up], axis=1) / lengths[:, None]
        mujoco.mj_multiRay(model, data, eye[:3], rays.ravel(), None, 1, base, geoms, found, None, count, 1e3)
        for pixel in np.flatnonzero(np.abs(_within(found / lengths, view) - seen_m.ravel()) > _WRONG_M).tolist():
            found[pixel] = mujoco.mj_ray(model, data, eye[:3], rays[pixel], None, 1, base, geoms[:1])
        depths.append(_within(found / lengths, view).reshape(view.rows, view.columns))
    return np.stack(depths)


def _within(depth_m: np.ndarray, view: View) -> np.ndarray:
    """Returns depths as a camera has them: its range where nothing is nearer."""
    return np.where(depth_m < 0.0, view.range_m, np.minimum(depth_m, view.range_m))


def _drawn(world: World, view: View, eyes: np.ndarray, _: Depths) -> Depths:
    camera = ColorCameraDeclaration(range_m=view.range_m, z_m=_HEIGHT_M, pitch_rad=view.pitch_rad)
    renderer = CameraRenderer(world, camera)
    poses = [mounted(camera, x, y, yaw) for x, y, _, yaw in eyes.astype(float).tolist()]
    depths = np.stack([renderer.depth_and_solids(pose)[0] for pose in poses])
    renderer.close()
    return depths


_REFERENCES: Mapping[str, Callable[[World, View, np.ndarray, Depths], Depths]] = {
    "MuJoCo's rays": _by_rays,
    "the GL": _drawn,
}


def _eyes(world: World, rng: np.random.Generator) -> Iterator[tuple[float, np.ndarray]]:
    """Yields how cameras are turned down, and random free places of many of them in a world."""
    near = ((each, abs(each.center_m[2] - _HEIGHT_M) - each.half_extents_m[2]) for each in solids(world))
    outlines = [shapely.Polygon(corners_m(each)) for each, apart_m in near if apart_m < _FREE_M]
    taken = shapely.union_all(outlines).buffer(_FREE_M)
    free = shapely.difference(shapely.union_all([_box(room.floor) for room in world.rooms]), taken)
    area = world.footprint
    low, high = (area.x_min_m, area.y_min_m, _HEIGHT_M, -np.pi), (area.x_max_m, area.y_max_m, _HEIGHT_M, np.pi)
    for pitch_rad, some in zip(_PITCHES_RAD, np.array_split(np.arange(_PICTURES), len(_PITCHES_RAD)), strict=True):
        eyes = rng.uniform(low, high, (20 * len(some), 4)).astype(np.float32)
        yield pitch_rad, eyes[shapely.contains_xy(free, eyes[:, 0], eyes[:, 1])][: len(some)]


def _box(area: Rectangle) -> shapely.Polygon:
    return shapely.box(area.x_min_m, area.y_min_m, area.x_max_m, area.y_max_m)


def main() -> None:
    """Compares, and prints the table or puts it into a document."""
    arguments = options(__doc__).parse_args()
    context = mujoco.GLContext(64, 48)
    totals = {(name, pitch_rad): _Found() for name in _REFERENCES for pitch_rad in _PITCHES_RAD}
    for number in range(_WORLDS):
        world = generate_world(
            read_template(_TEMPLATE), seed=number, generation="flat", floorplan_index=1, interior_index=1
        )
        for pitch_rad, eyes in _eyes(world, np.random.default_rng(number)):
            camera = ColorCameraDeclaration()
            view = View(camera.columns, camera.rows, camera.fov_rad, pitch_rad, _FAR_M)
            ours = _ours(world, view, eyes)
            context.make_current()
            for name, depths in _REFERENCES.items():
                found = _compared(ours, depths(world, view, eyes, ours))
                totals[name, pitch_rad] = totals[name, pitch_rad].and_also(found)
                print(number, pitch_rad, name, found, flush=True)
    rows = [["beside", "pitch", "pixels", "off edges, more than 1 mm off", "most", "at edges", "more than 1 mm off"]]
    for (name, pitch_rad), found in totals.items():
        counts = (found.pixels, found.wrong, found.at_edges, found.wrong_at_edges)
        pixels, wrong, at_edges, wrong_at_edges = (f"{each:,}" for each in counts)
        rows.append([name, f"{pitch_rad:g}", pixels, wrong, f"{1e3 * found.most_m:.3g} mm", at_edges, wrong_at_edges])
    note = f"Of {_WORLDS * _PICTURES:,} pictures of 64x48 from random free places in {_WORLDS} flats of six rooms"
    show("camera agreement", f"{markdown(rows)}\n\n{note}; drawn by {gl_name()}.", arguments.document)


if __name__ == "__main__":
    main()
