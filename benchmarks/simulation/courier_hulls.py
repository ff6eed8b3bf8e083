"""The courier's deliveries in apartments with hulls that ``planar`` refuses: ``mjx`` beside ``mujoco``.

    .venv/bin/python -m benchmarks.simulation.courier_hulls [--hulls box ...] [--document docs/reference/engines.md]

``ten_robots`` has robots that swing among obstacles and touch something most of the time, which is MJX's worst case.
Here they plan and drive, as robots do. A hull takes a minute, most of which MJX compiles.
"""

import argparse
import re
import shutil
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from benchmarks.machine import machine
from benchmarks.tables import markdown, with_tables
from tasks.simulate.devices import prepare_devices

prepare_devices()

# JAX reads its settings when it is imported.
from benchmarks.simulation.batch_engines import COURIER, apartment, deliveries, shipped  # noqa: E402
from benchmarks.simulation.engine_variants import SliceTimes, slice_times  # noqa: E402
from tasks.simulate.engines.engine_table import choose_engine  # noqa: E402
from tasks.simulate.geometry.world_arrays import grid_cells  # noqa: E402

LANES, WORLDS, TURNS = 256, 16, 8
HULLS: Mapping[str, str] = {
    "ball": '<geom name="hull" type="sphere" size="0.18" mass="2" condim="1"/>',
    "capsule that lies": '<geom name="hull" type="capsule" fromto="-0.06 0 0 0.06 0 0" size="0.12" mass="2"/>',
    "box": '<geom name="hull" type="box" size="0.14 0.11 0.1" mass="2"/>',
}
HEAD = ["hull", "mujoco, ms a slice", "mjx, ms", "mjx x mujoco", "mujoco, first slice s", "mjx, first s", "auto takes"]


def delivery_times(folders: Mapping[str, Path], engine: str) -> SliceTimes:
    """Returns what slices of the courier's deliveries take."""
    # Of one size of map: others would be another program.
    apartments = [apartment(number) for number in range(3 * WORLDS)]
    alike = [world for world in apartments if grid_cells(world) == grid_cells(apartments[0])][:WORLDS]
    worlds = {f"bench/{number}": world for number, world in enumerate(alike)}
    requests = [
        each.model_copy(update={"world": f"bench/{number % len(worlds)}"})
        for number, each in enumerate(deliveries()[:LANES])
    ]
    return slice_times(requests, worlds, folders, engine=engine, turns=TURNS)


def row(hull: str) -> list[str]:
    """Returns a hull's row."""
    with tempfile.TemporaryDirectory(prefix="simyard-hull-") as name:
        folder = Path(name) / "courier"
        shutil.copytree(shipped()[COURIER], folder)
        robot = folder / "robot.xml"
        changed, count = re.subn(r'<geom name="hull".*?/>', HULLS[hull], robot.read_text(), flags=re.DOTALL)
        if count != 1:
            raise ValueError(f"{robot}: one geom named hull is expected, and there are {count}")
        robot.write_text(changed)
        folders = {**shipped(), COURIER: folder}
        (c_first_s, c_s), (mjx_first_s, mjx_s) = (delivery_times(folders, engine) for engine in ("mujoco", "mjx"))
        auto = choose_engine("auto", robot, "jax", "cpu").engine
    times = [f"{c_s * 1e3:.0f}", f"{mjx_s * 1e3:.0f}", f"{c_s / mjx_s:.1f}", f"{c_first_s:.0f}", f"{mjx_first_s:.0f}"]
    return [hull, *times, auto]


def main() -> None:
    """Prints the table, or writes it into a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hulls", nargs="*", choices=tuple(HULLS), default=tuple(HULLS))
    parser.add_argument("--document", type=Path)
    given = parser.parse_args()
    text = f"{machine()} {LANES} lanes:\n\n{markdown([HEAD, *(row(hull) for hull in given.hulls)])}"
    if given.document:
        given.document.write_text(with_tables(given.document.read_text(), "courier hulls", text))
    else:
        sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main()
