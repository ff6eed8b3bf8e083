"""Simulation side by side: what one writes with MuJoCo's Python package, and Simyard's engines; closed loop with lidar.

    .venv/bin/python benchmarks/simulation.py [--scaling] [--batch] [--repeats N] [--without NAME ...] [--json FILE]

One robot, one controller, 32 rays at 20 Hz, physics at 200 Hz, 100 obstacles, 256 lanes in 16 worlds. The variants take
turns, and medians over the turns are shown, with the processor time of a lane's control step, which a busy machine
changes less. Stock MJX is so slow that it runs few lanes for few steps; its rate is that of the steps it made.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.tables import markdown
from tasks.simulate.devices import device_count, prepare_devices

prepare_devices()

from benchmarks.simulation_variants import (  # noqa: E402 - JAX reads its settings when it is imported
    PHYSICS_STEPS,
    Ours,
    RolloutLoop,
    StepLoop,
    StockMjx,
    Variant,
)
from benchmarks.simulation_worlds import FOLDERS, bench_world, explorations  # noqa: E402

LANES, OBSTACLES = 256, 100
STOCK_LANES = 16
LOOP, ROLLOUT, STOCK = "mj_step loop", "mujoco.rollout", "stock MJX"
PLAIN_C = (LOOP, ROLLOUT)
ENGINES = ("mujoco", "mjx", "planar")
SCALED_LANES, SCALED_OBSTACLES = (1, 16, 64, 256, 1024, 4096), (25, 100, 400)
BATCH_EPISODES, BATCH_WORLDS, BATCH_LANES, BATCH_S = 1000, 50, 256, 60.0


class Turn(NamedTuple):
    """One measurement: lane-steps a wall second, and processor microseconds of a lane's control step."""

    rate: float
    cpu_us: float


def makers(lanes: int, obstacles: int) -> dict[str, Callable[[], Variant]]:
    """Returns how to make each variant, by name."""
    threads = device_count()
    ours = {name: lambda name=name: Ours(name, lanes, obstacles) for name in ENGINES}
    return {
        LOOP: lambda: StepLoop(lanes, obstacles),
        ROLLOUT: lambda: RolloutLoop(lanes, obstacles, threads),
        STOCK: lambda: StockMjx(min(lanes, STOCK_LANES), obstacles),
        **ours,
    }


def turns(variants: Mapping[str, Variant], repeats: int, steps: Mapping[str, int]) -> dict[str, list[Turn]]:
    """Returns each variant's measurements; the variants take turns after one turn that is not counted."""
    for name, variant in variants.items():
        variant.run(min(steps[name], 25))
    found: dict[str, list[Turn]] = {name: [] for name in variants}
    for _ in range(repeats):
        for name, variant in variants.items():
            found[name].append(one_turn(variant, steps[name]))
    return found


def one_turn(variant: Variant, steps: int) -> Turn:
    """Returns one measurement."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    done = variant.run(steps) * variant.lanes
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    return Turn(done * PHYSICS_STEPS / wall_s, cpu_s / done * 1e6)


def control_steps(name: str, lanes: int) -> int:
    """Returns how long a turn is: the slow ones are kept short."""
    if name == STOCK:
        return 2
    return 25 if name in PLAIN_C or lanes > LANES else 100


def side_by_side(repeats: int, without: Sequence[str]) -> dict[str, list[Turn]]:
    """Returns the measurements of all variants at the usual size."""
    variants = {name: make() for name, make in makers(LANES, OBSTACLES).items() if name not in without}
    return turns(variants, repeats, {name: control_steps(name, LANES) for name in variants})


def rows(found: Mapping[str, Sequence[Turn]]) -> list[list[str]]:
    """Returns a table of variants, with the best C variant as the measure."""
    rates = {name: median(turn.rate for turn in each) for name, each in found.items()}
    best = max((rates[name] for name in PLAIN_C if name in rates), default=float("nan"))
    table = [["variant", "k lane-steps/s", "from", "to", "x best plain C", "CPU us a control step"]]
    for name, each in found.items():
        ordered = sorted(turn.rate / 1e3 for turn in each)
        cpu = median(turn.cpu_us for turn in each)
        table.append(
            [
                name,
                f"{rates[name] / 1e3:,.1f}",
                f"{ordered[0]:,.1f}",
                f"{ordered[-1]:,.1f}",
                f"{rates[name] / best:.2f}",
                f"{cpu:,.1f}",
            ]
        )
    return table


def scaling(repeats: int) -> dict[str, list[list[str]]]:
    """Returns tables over lanes and over obstacles, in thousands of lane-steps a second."""
    names = (ROLLOUT, *ENGINES)
    sizes = {
        "lanes": [(lanes, OBSTACLES) for lanes in SCALED_LANES],
        "obstacles": [(LANES, count) for count in SCALED_OBSTACLES],
    }
    tables: dict[str, list[list[str]]] = {}
    for axis, pairs in sizes.items():
        tables[axis] = [[axis, *names]]
        for lanes, obstacles in pairs:
            made = {name: makers(lanes, obstacles)[name]() for name in names}
            found = turns(made, repeats, dict.fromkeys(names, 25))
            size = lanes if axis == "lanes" else obstacles
            tables[axis].append(
                [f"{size:,}", *(f"{median(turn.rate for turn in found[name]) / 1e3:,.1f}" for name in names)]
            )
    return tables


def run_batch(folder: Path) -> None:
    """Simulates the batch in this process, from worlds that lie in a folder, and leaves its figures there."""
    from specs.world import World  # noqa: PLC0415 - what a run imports counts as its start-up
    from tasks.simulate.chunks import plan_chunks  # noqa: PLC0415
    from tasks.simulate.runner import simulate_chunk  # noqa: PLC0415

    worlds = {f"bench/{k}": World.model_validate_json((folder / f"{k}.json").read_bytes()) for k in range(BATCH_WORLDS)}
    requests, passed = explorations(BATCH_EPISODES, BATCH_WORLDS, BATCH_S), 0
    for chunk in plan_chunks(requests, BATCH_LANES):
        ended = simulate_chunk(chunk, worlds, FOLDERS, lanes=BATCH_LANES, should_stop=lambda: False)
        passed += sum(row.status == "Completed" and row.simulated_s == BATCH_S for row in ended)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    (folder / "figures.json").write_text(json.dumps({"completed": passed, "peak_mib": peak_mib}))


def batch(repeats: int) -> list[list[str]]:
    """Returns the seconds of 1,000 episodes of 60 s in 50 worlds, process start included, cold once and then warm."""
    table = [["run", "wall s", "episodes", "peak MiB"]]
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as name:
        folder = Path(name)
        for k in range(BATCH_WORLDS):
            (folder / f"{k}.json").write_text(bench_world(k, OBSTACLES).model_dump_json())
        for number in range(1 + repeats):
            start_s = time.perf_counter()
            subprocess.run([sys.executable, __file__, "--batch-once", name], check=True)
            wall_s = time.perf_counter() - start_s
            figures = json.loads((folder / "figures.json").read_text())
            label = "first" if number == 0 else f"warm {number}"
            table.append([label, f"{wall_s:.1f}", f"{figures['completed']:,}", f"{figures['peak_mib']:,.0f}"])
    return table


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--without", nargs="*", default=[], help="variants to leave out")
    parser.add_argument("--scaling", action="store_true")
    parser.add_argument("--batch", action="store_true")
    parser.add_argument("--batch-once", type=Path)
    options = parser.parse_args()
    if options.batch_once:
        run_batch(options.batch_once)
        return
    tables: dict[str, list[list[str]]] = {}
    if options.scaling:
        tables |= scaling(options.repeats)
    if options.batch:
        tables["batch"] = batch(options.repeats)
    if not tables:
        tables["side by side"] = rows(side_by_side(options.repeats, options.without))
    for title, table in tables.items():
        print(f"\n{title}\n\n{markdown(table)}", flush=True)
    if options.json:
        options.json.write_text(json.dumps(tables, indent=2))


if __name__ == "__main__":
    main()
