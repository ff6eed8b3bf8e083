"""Rays a second of one core: Simyard's lidar beside range_libc's ray casters, at their best settings, in one run.

    python -m benchmarks.rivals.rays --range-libc FOLDER [--turns N] [--document FILE]

FOLDER is range_libc's source code (github.com/kctess5/range_libc). All cast the same 32 rays from the same free places
of a bench world of 100 obstacles. range_libc's are on a grid, at the sizes of cells and directions given; Simyard's are
from outlines. How far ranges are from C MuJoCo's rays says how exact each is.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=1"

from tasks.simulate.devices import prepare_devices

prepare_devices()

import jax  # noqa: E402 - JAX reads its settings when it is imported
import jax.numpy as jnp  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from jaxtyping import Bool, Float32  # noqa: E402

from benchmarks.machine import machine  # noqa: E402
from benchmarks.rivals.range_libc import Scans, built, cast, occupied  # noqa: E402
from benchmarks.simulation.engine_worlds import bench_world  # noqa: E402
from benchmarks.tables import markdown, with_tables  # noqa: E402
from tasks.simulate.geometry.lidar_scan import (  # noqa: E402
    LidarOutlines,
    lidar_outlines,
    pad_lidar_outlines,
    scan_ranges,
)
from tasks.simulate.geometry.obstacles import Obstacles, obstacles  # noqa: E402
from tasks.simulate.sensors.lidar import Lidar, ray_angles  # noqa: E402

LIDAR = Lidar(rays=32, range_m=10.0, height_m=0.2)
OBSTACLES, POSES, LANES, SEED = 100, 4096, 128, 20261124
# Of the map, and of the hall in it.
_HALF_M, _INNER_M = 7.0, 5.9
_SEEN_M = 0.001
# Method, cell (m), directions.
SETTINGS = (
    ("CDDT", 0.05, 108),
    ("pruned CDDT", 0.05, 108),
    ("pruned CDDT", 0.02, 360),
    ("pruned CDDT", 0.01, 1440),
    ("ray marching", 0.05, 0),
    ("ray marching", 0.01, 0),
    ("lookup table", 0.05, 108),
)
HEAD = ["caster", "million rays/s a core", "error, median mm", "error, 90 % mm", "off by more than 5 cm, %"]


def free_poses(cells: Bool[np.ndarray, "x y"], cell_m: float, half_m: float) -> Float32[np.ndarray, "poses 3"]:
    """Returns drawn places at which a robot might be, x and y in metres, yaw in radians."""
    rng = np.random.default_rng(SEED)
    # A robot's middle is never in a cell beside a solid, part of which may lie in the solid.
    taken = [np.roll(cells, (rows, columns), (0, 1)) for rows in (-1, 0, 1) for columns in (-1, 0, 1)]
    inside = ~np.logical_or.reduce(taken)
    edge = int((half_m - _INNER_M) / cell_m)
    inside[:edge] = inside[-edge:] = False
    inside[:, :edge] = inside[:, -edge:] = False
    chosen = rng.choice(np.argwhere(inside), POSES)
    places = (chosen + rng.uniform(0.1, 0.9, chosen.shape)) * cell_m - half_m
    return np.column_stack([places, rng.uniform(-np.pi, np.pi, POSES)]).astype(np.float32)


def exact_m(solids: Obstacles, poses: Float32[np.ndarray, "poses 3"]) -> np.ndarray:
    """Returns what C MuJoCo's rays measure among the same solids, poses by rays."""
    spec = mujoco.MjSpec()
    for box in solids.boxes.astype(float):
        geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=box[3:6], pos=box[:3])
        yaw = np.arctan2(box[7], box[6])
        geom.quat = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
    for cylinder in solids.cylinders.astype(float):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[cylinder[3], cylinder[4], 0.0], pos=cylinder[:3]
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found, geom_id, angles = np.empty((len(poses), LIDAR.rays)), np.zeros(1, np.int32), ray_angles(LIDAR).astype(float)
    for place, (x, y, yaw) in enumerate(poses.astype(float)):
        start = np.array([x, y, LIDAR.height_m])
        for ray, angle in enumerate(yaw + angles):
            way = np.array([np.cos(angle), np.sin(angle), 0.0])
            found[place, ray] = mujoco.mj_ray(model, data, start, way, None, 1, -1, geom_id, None)
    return np.where((found < 0.0) | (found > LIDAR.range_m), LIDAR.range_m, found)


def ours(solids: Obstacles, poses: Float32[np.ndarray, "poses 3"], turns: int) -> tuple[float, np.ndarray]:
    """Returns Simyard's rays a processor second, and its ranges."""
    seen = LidarOutlines(*map(jnp.asarray, pad_lidar_outlines([lidar_outlines(solids)])[0]))
    each_lane = jax.tree.map(lambda array: jnp.broadcast_to(array, (LANES, *array.shape)), seen)
    angles = ray_angles(LIDAR)
    scan = jax.jit(jax.vmap(lambda here, pose: scan_ranges(here, pose, angles, LIDAR.range_m)))
    blocks = [jnp.asarray(block) for block in poses.reshape(-1, LANES, 3)]
    found = [scan(each_lane, block) for block in blocks]
    seconds: list[float] = []
    for _ in range(turns):
        begun = time.process_time()
        found = jax.block_until_ready([scan(each_lane, block) for block in blocks])
        seconds.append(time.process_time() - begun)
    return poses.shape[0] * LIDAR.rays / median(seconds), np.concatenate([np.asarray(each) for each in found])


def row(name: str, rays_s: float, off_m: np.ndarray) -> list[str]:
    """Returns a row of the table."""
    middle, most = np.quantile(off_m, (0.5, 0.9)) * 1e3
    far = 100 * float(np.mean(off_m > 0.05))
    return [name, f"{rays_s / 1e6:.1f}", f"{middle:.2f}", f"{most:.2f}", f"{far:.2f}"]


def table(source: Path, turns: int) -> str:
    """Returns the table of all casters."""
    solids = obstacles(bench_world(0, OBSTACLES), LIDAR.height_m - _SEEN_M, LIDAR.height_m + _SEEN_M)
    half_m = _HALF_M
    poses = free_poses(occupied(solids, 0.05, half_m), 0.05, half_m)
    truth_m = exact_m(solids, poses)
    rays_s, ranges_m = ours(solids, poses, turns)
    rows = [HEAD, row("Simyard, outlines", rays_s, np.abs(ranges_m - truth_m))]
    with tempfile.TemporaryDirectory(prefix="simyard-rays-") as folder:
        program = built(source, Path(folder))
        for method, cell_m, slices in SETTINGS:
            in_cells = np.column_stack([(poses[:, :2] + half_m) / cell_m, poses[:, 2]]).astype(np.float32)
            scans = Scans(occupied(solids, cell_m, half_m), in_cells, LIDAR.rays, LIDAR.range_m / cell_m, turns)
            found = cast(program, scans, method, slices)
            name = f"{method}, {100 * cell_m:.0f} cm" + (f", {slices} directions" if slices else "")
            off_m = np.abs(np.minimum(found.ranges_cells * cell_m, LIDAR.range_m) - truth_m)
            rows.append(row(name, found.rays_s, off_m))
    return markdown(rows)


def main() -> None:
    """Prints the table, or writes it into a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--range-libc", type=Path, required=True)
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--document", type=Path)
    given = parser.parse_args()
    text = f"{machine()} {OBSTACLES} obstacles, one thread:\n\n{table(given.range_libc, given.turns)}"
    if given.document:
        given.document.write_text(with_tables(given.document.read_text(), "rays", text))
    else:
        sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main()
