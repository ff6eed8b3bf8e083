"""How long `simyard run examples/worlds-only.yaml` takes: without a server, with its own and with a kept one.

    .venv/bin/python benchmarks/door.py [--runs N]

The work itself takes 0.2 s; the rest is what a user waits for at the door. Each run is a process with a new store. The
first run with its own server makes Prefect's database. CPU counts the run and its own server, but not a kept one.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from benchmarks.harness import ROOT, markdown

DOCUMENT = "examples/worlds-only.yaml"
_SIMYARD = str(Path(sys.executable).with_name("simyard"))
_HEAD = ("worlds-only.yaml", "wall, median (s)", "wall, least (s)", "CPU, median (s)")


class Cost(NamedTuple):
    """What a run took."""

    wall_s: float
    cpu_s: float


def environment(folder: Path) -> dict[str, str]:
    """Returns the variables of runs that share a Prefect database and a cache, and nothing with this machine's user."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "SIMYARD_"))}
    home = {"PREFECT_HOME": str(folder / "prefect"), "SIMYARD_CACHE": str(folder / "cache")}
    return {**kept, **home, "PYTHONPATH": str(ROOT)}


def run_once(variables: Mapping[str, str], *options: str) -> Cost:
    """Returns what one run took, with a store of its own."""
    with tempfile.TemporaryDirectory(prefix="simyard-door-") as folder:
        command = [_SIMYARD, "run", DOCUMENT, "--store", (Path(folder) / "store").as_uri(), *options]
        before, start_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, cwd=ROOT, env=variables, check=True, stdout=subprocess.DEVNULL)
        wall_s, after = time.perf_counter() - start_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def measure(runs: int) -> dict[str, list[Cost]]:
    """Returns what the runs of each way took, by its name."""
    with tempfile.TemporaryDirectory(prefix="simyard-door-") as folder:
        variables = environment(Path(folder))
        costs = {
            "without a server (--direct)": [run_once(variables, "--direct") for _ in range(runs)],
            "own server, the first run": [run_once(variables)],
            "own server": [run_once(variables) for _ in range(runs)],
        }
        subprocess.run([_SIMYARD, "up"], env=variables, check=True, stdout=subprocess.DEVNULL)
        try:
            costs["kept server"] = [run_once(variables) for _ in range(runs)]
        finally:
            subprocess.run([_SIMYARD, "down"], env=variables, check=True, stdout=subprocess.DEVNULL)
    return costs


def row(name: str, costs: list[Cost]) -> tuple[str, ...]:
    """Returns a line of the table."""
    wall_s, cpu_s = [cost.wall_s for cost in costs], [cost.cpu_s for cost in costs]
    return (name, *(f"{figure:.1f}" for figure in (statistics.median(wall_s), min(wall_s), statistics.median(cpu_s))))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=5)
    costs = measure(parser.parse_args().runs)
    print(markdown([_HEAD, *(row(name, of_way) for name, of_way in costs.items())]))


if __name__ == "__main__":
    main()
