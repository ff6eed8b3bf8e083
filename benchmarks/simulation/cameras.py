"""Depth pictures a second of processor time, beside ``mj_multiRay`` in the same world: ``docs/guide/cameras.md``."""

import time
from collections.abc import Callable, Iterator

import jax
import mujoco
import numpy as np

from benchmarks.harness import machine, markdown, options, show
from benchmarks.simulation.engine_worlds import ROBOT_FILE, bench_world
from specs.data.world import World
from tasks.simulate.engines.mujoco.world_stepper import host_robot, world_model
from tasks.simulate.geometry.depth_picture import View, depth_picture, depth_scene, pad_scenes, rays_of

_SOLIDS = (40, 166, 406)
_PICTURES = ((64, 48, 0.0), (64, 48, 0.4), (160, 120, 0.0), (320, 240, 0.0))
_EYES = 32
_MEASURED_S = 1.0


def _rate(pictures: int, take: Callable[[], object]) -> float:
    """Returns pictures a second of processor time, the first call apart."""
    take()
    done, began_s = 0, time.process_time()
    while time.process_time() - began_s < _MEASURED_S:
        take()
        done += pictures
    return done / (time.process_time() - began_s)


def _ours(world: World, view: View, eyes: np.ndarray) -> float:
    scene = pad_scenes([depth_scene(world)])[0]
    taken = jax.jit(lambda seen, each: jax.lax.map(lambda eye: depth_picture(seen, eye, view), each))
    return _rate(len(eyes), lambda: taken(scene, eyes).block_until_ready())


def _theirs(world: World, view: View, eyes: np.ndarray) -> float:
    model = world_model(host_robot(ROBOT_FILE), world)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ahead, left, up = (each.astype(np.float64).ravel() for each in np.broadcast_arrays(*rays_of(view)))
    lengths, base = np.sqrt(ahead**2 + left**2 + up**2), int(model.jnt_bodyid[0])
    geoms, found = np.empty(len(ahead), np.int32), np.empty(len(ahead))
    turns = np.stack([np.cos(eyes[:, 3]), np.sin(eyes[:, 3])], axis=1).astype(np.float64)
    places = iter(_again(len(eyes)))

    def take() -> None:
        at = next(places)
        cos, sin = turns[at]
        rays = np.stack([cos * ahead - sin * left, sin * ahead + cos * left, up], axis=1) / lengths[:, None]
        eye = eyes[at, :3].astype(np.float64)
        mujoco.mj_multiRay(
            model, data, eye, rays.ravel(), None, 1, base, geoms, found, None, len(ahead), 2.0 * view.range_m
        )

    return _rate(1, take)


def _again(count: int) -> Iterator[int]:
    while True:
        yield from range(count)


def main() -> None:
    """Measures, and prints the table or puts it into a document."""
    arguments = options(__doc__).parse_args()
    rows = [["solids", "picture", "pitch", "Simyard", "`mj_multiRay`"]]
    for count in _SOLIDS:
        world, rng = bench_world(0, count), np.random.default_rng(0)
        eyes = rng.uniform((-1.0, -1.0, 0.3, -np.pi), (1.0, 1.0, 0.3, np.pi), (_EYES, 4)).astype(np.float32)
        for columns, lines, pitch_rad in _PICTURES:
            view = View(columns, lines, 1.2, pitch_rad, 10.0)
            rates = [f"{each(world, view, eyes):,.0f}" for each in (_ours, _theirs)]
            rows.append([f"{count}", f"{columns}x{lines}", f"{pitch_rad:g}", *rates])
    show("cameras", f"{markdown(rows)}\n\nPictures a second of processor time, on {machine()}", arguments.document)


if __name__ == "__main__":
    main()
