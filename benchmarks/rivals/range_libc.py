"""Builds a program of range_libc (CDDT and others, C. Walsh and S. Karaman, 2017), and has it cast rays."""

import subprocess
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from tasks.simulate.geometry.obstacles import Obstacles

SOURCE = Path(__file__).with_name("range_libc_rays.cpp")


class Cast(NamedTuple):
    """What one method did.

    Attributes:
        rays_s: Rays a second of one thread's processor time, the median of its turns.
        ranges_cells: Of the last turn.
    """

    rays_s: float
    ranges_cells: Float32[np.ndarray, "poses rays"]


class Scans(NamedTuple):
    """What is to be cast.

    Attributes:
        cells: Whether something stands in each, x first.
        poses: x and y in cells, yaw in radians.
        rays: Of a scan, evenly around.
        most_cells: Longest range.
        turns: How often.
    """

    cells: Bool[np.ndarray, "x y"]
    poses: Float32[np.ndarray, "poses 3"]
    rays: int
    most_cells: float
    turns: int


def built(source: Path, folder: Path) -> Path:
    """Returns the program.

    Args:
        source: The folder of range_libc's source code.
        folder: Where to build it.

    Raises:
        subprocess.CalledProcessError: There is no C++ compiler, or it refused.
    """
    program = folder / "rays"
    lodepng = source / "vendor/lodepng/lodepng.cpp"
    # It says "using namespace" in headers, and has a "data" of its own: C++17's would be another.
    command = ["c++", "-std=c++14", "-O3", "-march=native", "-ffast-math", "-w", f"-I{source}", "-DUSE_CUDA=0"]
    subprocess.run([*command, str(SOURCE), str(lodepng), "-o", str(program)], check=True)
    return program


def occupied(solids: Obstacles, cell_m: float, half_m: float) -> Bool[np.ndarray, "x y"]:
    """Returns in which cells of a square about the origin something stands at its middle."""
    sides = np.arange(-half_m, half_m, cell_m) + cell_m / 2
    x, y = np.meshgrid(sides, sides, indexing="ij")
    found = np.zeros(x.shape, bool)
    for box in solids.boxes.astype(float):
        dx, dy, (cos, sin) = x - box[0], y - box[1], box[6:8]
        found |= (np.abs(cos * dx + sin * dy) <= box[3]) & (np.abs(cos * dy - sin * dx) <= box[4])
    for cylinder in solids.cylinders.astype(float):
        found |= (x - cylinder[0]) ** 2 + (y - cylinder[1]) ** 2 <= cylinder[3] ** 2
    return found


def cast(program: Path, scans: Scans, method: str, slices: int) -> Cast:
    """Returns what a method does, whose tables have so many directions, if it has any.

    Raises:
        subprocess.CalledProcessError: The program failed.
    """
    folder = program.parent
    grid, poses, found = folder / "grid", folder / "poses", folder / "found"
    size = np.array(scans.cells.shape, np.int32)
    grid.write_bytes(size.tobytes() + scans.cells.astype(np.uint8).tobytes())
    poses.write_bytes(np.ascontiguousarray(scans.poses, np.float32).tobytes())
    numbers = (slices, scans.turns, scans.rays, scans.most_cells)
    command = [str(program), str(grid), str(poses), str(found), method, *map(str, numbers)]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    seconds = [float(each) for each in said[-scans.turns :]]
    ranges = np.fromfile(found, np.float32).reshape(len(scans.poses), scans.rays)
    return Cast(ranges.size / median(seconds), ranges)
