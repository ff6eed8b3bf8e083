"""Simulation side by side: what one writes with MuJoCo's Python package, and Simyard's engines; closed loop with lidar.

    .venv/bin/python benchmarks/simulation/engines.py [--scaling] [--batch] [--people] [--robots] [--beside] [--prisms]
    [--repeats N] [--without NAME ...] [--json FILE]
    .venv/bin/python benchmarks/simulation/engines.py --document docs/reference/engines.md    # all of it, into the
    document

One robot, one controller, 32 rays at 20 Hz, physics at 200 Hz, 100 obstacles, 256 lanes in 16 worlds. The variants take
turns, and medians over the turns are shown, with the processor time of a lane's control step, which a busy machine
changes less. Stock MJX is so slow that it runs few lanes for few steps; its rate is that of the steps it made.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from statistics import median
from typing import NamedTuple

from benchmarks.harness import machine, markdown, options, show
from benchmarks.simulation.batch_engines import batch_table
from specs.data.people import People
from tasks.simulate.devices import device_count, prepare_devices

prepare_devices()

from benchmarks.simulation.engine_variants import (  # noqa: E402 - JAX reads its settings when it is imported
    PHYSICS_STEPS,
    BatchLoop,
    Ours,
    RolloutLoop,
    StepLoop,
    StockMjx,
    Variant,
)

LANES, OBSTACLES = 256, 100
STOCK_LANES = 16
LOOP, ROLLOUT, BATCH, STOCK = "mj_step loop", "mujoco.rollout", "mujoco.batch", "stock MJX"
PLAIN_C = (LOOP, ROLLOUT, BATCH)
ENGINES = ("mujoco", "mjx", "planar")
SCALED_LANES, SCALED_OBSTACLES = (1, 16, 64, 256, 1024, 4096), (25, 100, 400)
SCALING_REPEATS, WARM_RUNS = 3, 2
WALKING, WALKED_OBSTACLES = (0, 1, 4, 8), 25
SHARING = (1, 2, 4, 8)
BESIDE = ((1, 0), (1, 8), (4, 0), (4, 8))


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
        BATCH: lambda: BatchLoop(lanes, obstacles, threads),
        STOCK: lambda: StockMjx(min(lanes, STOCK_LANES), obstacles),
        **ours,
    }


def turns(variants: Mapping[str, Variant], repeats: int, steps: Mapping[str, int]) -> dict[str, list[Turn]]:
    """Returns each variant's measurements; the variants take turns after one turn that is not counted."""
    for name, variant in variants.items():
        variant.run(min(steps[name], 5))
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
    """Returns how long a turn is: long enough to time, and the slow ones are kept short."""
    if name == STOCK:
        return 2
    if name in PLAIN_C:
        return 5 if lanes > LANES else 25
    return 25 if lanes > LANES else 100


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


def scaling(repeats: int) -> Iterator[tuple[str, list[list[str]]]]:
    """Yields tables over lanes and over obstacles, in thousands of lane-steps a second."""
    yield "lanes", scaled("lanes", [(lanes, OBSTACLES) for lanes in SCALED_LANES], repeats)
    yield "obstacles", scaled("obstacles", [(LANES, count) for count in SCALED_OBSTACLES], repeats)


def scaled(axis: str, sizes: Sequence[tuple[int, int]], repeats: int) -> list[list[str]]:
    """Returns a table over sizes, each (lanes, obstacles)."""
    names = (BATCH, *ENGINES)
    table = [[axis, *names, f"planar x {BATCH}"]]
    for lanes, obstacles in sizes:
        made = {name: makers(lanes, obstacles)[name]() for name in names}
        found = turns(made, repeats, {name: control_steps(name, lanes) for name in names})
        rates = {name: median(turn.rate for turn in found[name]) / 1e3 for name in names}
        cells = (f"{rate:,.1f}" for rate in rates.values())
        size = lanes if axis == "lanes" else obstacles
        table.append([f"{size:,}", *cells, f"{rates['planar'] / rates[BATCH]:.1f}"])
    return table


def walked(repeats: int) -> list[list[str]]:
    """Returns a table over how many people walk on ``planar``, in worlds where eight have room."""
    made: dict[str, Variant] = {
        str(count): Ours("planar", LANES, WALKED_OBSTACLES, People(count=count) if count else None) for count in WALKING
    }
    found = turns(made, repeats, {name: control_steps("planar", LANES) for name in made})
    costs = {name: median(turn.cpu_us for turn in each) for name, each in found.items()}
    rates = {name: median(turn.rate for turn in each) for name, each in found.items()}
    table = [["people", "k lane-steps/s", "CPU us a control step", "x none, wall", "x none, CPU"]]
    for name, rate in rates.items():
        times = (rates["0"] / rate, costs[name] / costs["0"])
        table.append([name, f"{rate / 1e3:,.1f}", f"{costs[name]:,.1f}", *(f"{each:.2f}" for each in times)])
    return table


def shared(repeats: int) -> list[list[str]]:
    """Returns a table over how many robots share a world on ``planar``: what one of them costs, and a world of them."""
    made: dict[str, Variant] = {str(count): Ours("planar", LANES, WALKED_OBSTACLES, robots=count) for count in SHARING}
    found = turns(made, repeats, {name: control_steps("planar", LANES) for name in made})
    costs = {name: median(turn.cpu_us for turn in each) for name, each in found.items()}
    rates = {name: median(turn.rate for turn in each) for name, each in found.items()}
    table = [["robots", "k lane-steps/s", "CPU us a control step of a robot", "a world x one, wall", "CPU"]]
    for name, rate in rates.items():
        times = (int(name) * rates["1"] / rate, int(name) * costs[name] / costs["1"])
        table.append([name, f"{rate / 1e3:,.1f}", f"{costs[name]:,.1f}", *(f"{each:.2f}" for each in times)])
    return table


def beside(repeats: int) -> list[list[str]]:
    """Returns a table over how many robots and people share a world on ``planar``."""
    made: dict[tuple[int, int], Variant] = {
        (robots, people): Ours(
            "planar", LANES, WALKED_OBSTACLES, People(count=people) if people else None, robots=robots
        )
        for robots, people in BESIDE
    }
    found = turns({str(each): variant for each, variant in made.items()}, repeats, dict.fromkeys(map(str, made), 100))
    costs = {each: median(turn.cpu_us for turn in found[str(each)]) for each in made}
    table = [["robots", "people", "CPU us a control step of a robot", "a world x one robot among as many people"]]
    for (robots, people), cost_us in costs.items():
        times = robots * cost_us / costs[1, people]
        table.append([str(robots), str(people), f"{cost_us:.1f}", f"{times:.2f}"])
    return table


def shaped(repeats: int) -> list[list[str]]:
    """Returns a table over what the boxes of a hall are written as, for each engine."""
    table = [["engine", "boxes, CPU us a control step", "prisms", "x boxes"]]
    for engine in ENGINES:
        made: dict[str, Variant] = {
            name: Ours(engine, LANES, OBSTACLES, prisms=name == "prisms") for name in ("boxes", "prisms")
        }
        found = turns(made, repeats, {name: control_steps(engine, LANES) for name in made})
        costs = {name: median(turn.cpu_us for turn in each) for name, each in found.items()}
        table.append([engine, *(f"{each:,.1f}" for each in costs.values()), f"{costs['prisms'] / costs['boxes']:.2f}"])
    return table


def main() -> None:
    """Prints the tables, and puts them into a document."""
    parser = options(__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--without", nargs="*", default=[], help="variants to leave out")
    parser.add_argument("--scaling", action="store_true")
    parser.add_argument("--batch", action="store_true")
    parser.add_argument("--people", action="store_true")
    parser.add_argument("--robots", action="store_true")
    parser.add_argument("--beside", action="store_true")
    parser.add_argument("--prisms", action="store_true")
    given = parser.parse_args()
    show("machine", machine(), given.document)
    for title, table in measured(given):
        show(title, markdown(table), given.document)


def measured(given: argparse.Namespace) -> Iterator[tuple[str, list[list[str]]]]:
    """Yields each table that was asked for when it is measured, under its title."""
    parts = given.scaling or given.batch or given.people or given.robots or given.beside or given.prisms
    everything = given.document is not None and not parts
    if not parts:
        yield "side by side", rows(side_by_side(given.repeats, given.without))
    if everything or given.batch:
        yield "batch", batch_table(min(given.repeats, WARM_RUNS))
    if everything or given.scaling:
        yield from scaling(min(given.repeats, SCALING_REPEATS))
    if given.people:
        yield "people", walked(given.repeats)
    if given.robots:
        yield "robots", shared(given.repeats)
    if given.beside:
        yield "people beside robots", beside(given.repeats)
    if given.prisms:
        yield "prisms", shaped(given.repeats)


if __name__ == "__main__":
    main()
