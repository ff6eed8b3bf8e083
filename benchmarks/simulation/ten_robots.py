"""Ten robots that ``planar`` refuses, on the other two engines: which is faster, and which the rule takes.

    .venv/bin/python -m benchmarks.simulation.ten_robots --robots box-base carrier --document docs/reference/engines.md

Every robot swings its actuators in the worlds of ``engines.py``, with 32 rays at 20 Hz. A robot's part takes up to ten
minutes, most of which MJX compiles; each part replaces its own rows of the table.
"""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.harness import ROOT, markdown, options, with_tables
from tasks.simulate.devices import prepare_devices

prepare_devices()

from benchmarks.simulation.engine_variants import PHYSICS_STEPS, WORLDS, slice_times  # noqa: E402 - JAX reads its settings when it is imported
from benchmarks.simulation.engine_worlds import FOLDERS, ROBOT, bench_world, explorations  # noqa: E402
from specs.data.episode import ApplicationLaunch  # noqa: E402
from tasks.simulate.application.mjcf_check import RobotRefused  # noqa: E402
from tasks.simulate.application.robot_file import read_robot_mjcf  # noqa: E402
from tasks.simulate.application.robot_model import compile_robot  # noqa: E402
from tasks.simulate.engines.engine_table import choose_engine  # noqa: E402
from tasks.simulate.plan.chunks import SLICE_STEPS  # noqa: E402

ROBOTS = ROOT / "benchmarks/simulation/robots"
APPLICATION = ROOT / "benchmarks/applications/swinger"
NAMES = tuple(sorted(path.stem for path in ROBOTS.glob("*.xml")))
LANES, ENGINES, OBSTACLES, TURNS = (64, 256, 1024), ("mujoco", "mjx"), 100, 3
TITLE = "ten robots"
_FOREVER_S = 1e7
_REFUSED = "refused"


def rates(name: str, engine: str, lanes: int) -> tuple[str, str]:
    """Returns thousands of lane-steps a second, and seconds from the start to the end of the first slice."""
    try:
        choose_engine(engine, ROBOTS / f"{name}.xml", "jax", "cpu")
    except RobotRefused:
        return _REFUSED, "-"
    with tempfile.TemporaryDirectory(prefix="simyard-robot-") as text:
        folder = Path(text)
        shutil.copytree(APPLICATION, folder, dirs_exist_ok=True)
        shutil.copy(ROBOTS / f"{name}.xml", folder / "robot.xml")
        actuators = compile_robot(read_robot_mjcf(folder / "robot.xml")).nu
        launch = ApplicationLaunch(name="swinger", version="1", digest=ROBOT, package="swinger", launch_file="sway")
        changes = {"robot": launch, "environment": {"ACTUATORS": f"x{actuators}"}}
        requests = [each.model_copy(update=changes) for each in explorations(lanes, WORLDS, _FOREVER_S)]
        worlds = {f"bench/{k}": bench_world(k, OBSTACLES) for k in range(WORLDS)}
        bundles = FOLDERS | {ROBOT: folder}
        first_s, slice_s = slice_times(requests, worlds, bundles, engine=engine, turns=TURNS)
        return f"{SLICE_STEPS * lanes * PHYSICS_STEPS / slice_s / 1e3:,.1f}", f"{first_s:.0f}"


def rows(name: str, counts: Sequence[int]) -> Iterator[list[str]]:
    """Yields a robot's rows, one for each number of lanes."""
    path = ROBOTS / f"{name}.xml"
    choice, speeds = choose_engine("auto", path, "jax", "cpu"), compile_robot(read_robot_mjcf(path)).nv
    for lanes in counts:
        (c_rate, _), (mjx_rate, mjx_s) = (rates(name, engine, lanes) for engine in ENGINES)
        ratio = "-" if _REFUSED in {c_rate, mjx_rate} else f"{_number(mjx_rate) / _number(c_rate):.2f}"
        yield [name, str(speeds), f"{lanes:,}", c_rate, mjx_rate, ratio, mjx_s, choice.engine]


def merged(document: str, found: Sequence[Sequence[str]]) -> str:
    """Returns a document with these rows in its table in place of those of the same robot and number of lanes."""
    begin, end = f"<!-- {TITLE} -->", f"<!-- end of {TITLE} -->"
    lines = document.partition(begin)[2].partition(end)[0].strip().splitlines()[2:]
    known = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    by_name = {(row[0], row[2]): row for row in [*known, *map(list, found)]}
    ordered = sorted(by_name.values(), key=lambda row: (row[0], _number(row[2])))
    return with_tables(document, TITLE, markdown([HEAD, *ordered]))


HEAD = ["robot", "degrees of freedom", "lanes", "mujoco", "mjx", "mjx x mujoco", "mjx first slice s", "auto takes"]


def _number(text: str) -> float:
    return float(text.replace(",", ""))


def main() -> None:
    """Prints the rows, and puts them into a document."""
    parser = options(__doc__)
    parser.add_argument("--robots", nargs="*", choices=NAMES, default=NAMES)
    parser.add_argument("--lanes", nargs="*", type=int, default=LANES)
    given = parser.parse_args()
    for name in given.robots:
        found = list(rows(name, given.lanes))
        print(markdown([HEAD, *found]), flush=True)
        if given.document:
            given.document.write_text(merged(given.document.read_text(), found))


if __name__ == "__main__":
    main()
