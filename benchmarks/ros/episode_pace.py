"""What episodes cost that a node of ROS 1 drives on the planar engine: control steps a second in the product.

    .venv/bin/python -m benchmarks.ros.episode_pace [--lanes 8 32] [--seconds S] [--confined]

Worlds, lidar of 360 rays, physics and rows are those of a batch; the node is in Python and answers each scan. The first
slice of control steps is left out: it compiles, and starts the nodes. ``--confined`` simulates as a batch does, in a
process of its own.
"""

import argparse
import os
import time
from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.tables import markdown
from specs.data.episode import CONTROL_HZ, ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.chunk.byproducts import ChunkTiming, collect_timings
from tasks.simulate.chunk.runner import simulate_columns
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk
from tasks.simulate.sandbox.sandbox_client import SandboxClient
from tests.factories.simulations import BUNDLES, DRIFT, FOLDERS, pen, pushing

_PATROL = "7" * 64
_ROBOT = ApplicationLaunch(name="patrol", version="1", digest=_PATROL, package="patrol", launch_file="patrol.launch")
_FOLDERS = {_PATROL: BUNDLES / "patrol", DRIFT: FOLDERS[DRIFT]}
_HEAD = ("episodes", "steps/s in all", "x real time", "first slice, s", "wall, s", "late, stray")


class Pace(NamedTuple):
    """What one chunk took."""

    timing: ChunkTiming
    wall_s: float
    rows: list[EpisodeResult]


def requests(lanes: int, seconds: float) -> list[EpisodeRequest]:
    """Returns episodes in three small rooms."""
    return [
        pushing(index, world=f"hand/pen-{index % 3}", seed=index, duration_s=seconds).model_copy(
            update={"robot": _ROBOT, "environment": {"SPEED": "0.3"}}
        )
        for index in range(lanes)
    ]


def pace(lanes: int, seconds: float, worlds: dict[str, World], *, confined: bool) -> Pace:
    """Returns what a chunk of so many episodes took."""
    chunk, begun_s = Chunk(number=0, requests=tuple(requests(lanes, seconds))), time.perf_counter()
    with collect_timings() as timings:
        if confined:
            apart = SandboxClient(bundles=_FOLDERS, lanes=lanes, engine="planar", should_stop=lambda: False)
            rows = list(apart.simulate(chunk, worlds))
        else:
            found = simulate_columns(chunk, worlds, _FOLDERS, lanes=lanes, engine="planar", should_stop=lambda: False)
            rows = found.rows()
    return Pace(timings[-1], time.perf_counter() - begun_s, rows)


def row(lanes: int, found: Pace) -> tuple[str, ...]:
    """Returns a line of the table."""
    timing = found.timing
    per_s = lanes * timing.slices * SLICE_STEPS / timing.slices_s
    late, stray = (sum(getattr(each, name) or 0 for each in found.rows) for name in ("late", "stray"))
    times = f"{per_s / CONTROL_HZ:.0f}"
    return (str(lanes), f"{per_s:.0f}", times, f"{timing.compile_s:.1f}", f"{found.wall_s:.1f}", f"{late}, {stray}")


def main(asked: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, nargs="+", default=[8, 32])
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--confined", action="store_true")
    given = parser.parse_args(asked)
    worlds = {f"hand/pen-{seed}": pen(4.5, seed) for seed in range(3)}
    print(f"load before: {os.getloadavg()[0]:.1f}")
    lines = [row(lanes, pace(lanes, given.seconds, worlds, confined=given.confined)) for lanes in given.lanes]
    print(markdown([_HEAD, *lines]))


if __name__ == "__main__":
    main()
