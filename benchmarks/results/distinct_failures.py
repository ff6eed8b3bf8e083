"""How many distinct failures a search finds beside plain random draws and a plain grid, with as many episodes each.

    .venv/bin/python -m benchmarks.results.distinct_failures --store FOLDER [--case CASE] [--episodes N]

The courier delivers in two apartments; its speed, the noise of its odometry, its mass and, in the case ``anywhere``,
where it begins vary. In the case ``goals`` the search alone draws goals by numbers near which it may look, the others
by seeds, as likely; what is counted knows nothing of these numbers. Failures of all three ways are counted alike, in
three ways: places (reason, world, metre), cells of an archive (place and tenth of each variable's distribution), and
failures each at least half a part from another (a part is another reason, another world, a metre, or all of the
variables' distributions; another seed alone makes no other failure). A quarter of a search's episodes look near
failures for others. A seed is three times as many episodes as are said, of the grid as many as its values, worlds and
seeds give. What was simulated is in the store, and is not simulated again; take another folder after a change.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

import simyard
from benchmarks.harness import ROOT, machine, markdown, options, show
from flows.batch.search_batch import DrawnEpisodes, SearchSteps
from specs.data.physics import OF_GOALS, OF_START, RANGES, PhysicalName
from specs.pipeline.search_section import Distribution, Normal, Search, SearchBudget, SearchFind
from tasks.results.statistics.distinct_failures import OF_PLACE, FailureTraits
from tasks.results.statistics.particles import Particles
from tasks.simulate.batch.batch_record import OpenBatch, load_batch
from tasks.simulate.devices import prepare_devices
from tasks.storage.jobs.records import records
from tasks.storage.resource_names import find_batch_name
from tasks.storage.store_url import open_store

WORLDS, APART = 2, 0.5
_MASS = Distribution(normal=Normal(mean=1.0, sd=0.1, atLeast=0.5, atMost=1.5))


class Case(NamedTuple):
    """What varies.

    Attributes:
        over: By name.
        values: So many of each variable a grid has.
        shares: What a search draws by numbers besides, and the others by seeds.
    """

    over: dict[str, Distribution]
    values: int
    shares: dict[str, Distribution] = {}  # noqa: RUF012 - of a tuple; nobody writes to it


def _shares(names: Sequence[PhysicalName]) -> dict[str, Distribution]:
    return {name: Distribution(uniform=(RANGES[name].least, RANGES[name].most)) for name in names}


_OVER = {
    "MAX_SPEED": Distribution(uniform=(0.3, 0.8)),
    "ODOMETRY_SIGMA": Distribution(logUniform=(0.01, 0.1)),
    "robot.mass": _MASS,
}
CASES = {
    "scenario": Case(_OVER, 10),
    "goals": Case(_OVER, 10, _shares(OF_GOALS)),
    "anywhere": Case(
        {
            "MAX_SPEED": Distribution(uniform=(0.2, 0.8)),
            "ODOMETRY_SIGMA": Distribution(logUniform=(0.01, 0.3)),
            "robot.mass": _MASS,
            **_shares(OF_START),
        },
        3,
    ),
}
WAYS = ("search", "random draws", "grid")
COUNTED = ("places", "cells", "far apart")


def batch(store: Path) -> str:
    """Returns the batch that is searched, the store's own if there is one; it has the worlds and the applications."""
    if made := records(open_store(store.absolute().as_uri()), "simulation-job-batch"):
        return made[0].id
    environment = {"MAX_SPEED": ["0.5"], "ODOMETRY_SIGMA": ["0.05"]}
    document = {
        "name": "distinct-failures",
        "worldGeneration": {
            "template": str(ROOT / "examples/templates/two-rooms.json"),
            "worldCount": {"floorplanCount": WORLDS},
            "seed": 7,
        },
        "simulationBatch": {
            "audit": {"lanes": 0},
            "matrix": {"seeds": 8, "environmentVariables": environment},
            "createSimulationJobRequests": [
                {
                    "maxJobDurationInSeconds": 120,
                    "robotApplications": [_launch("courier", "go_to_goal")],
                    "simulationApplications": [_launch("delivery", "rooms")],
                }
            ],
        },
    }
    run = simyard.run(document, store=store, direct=True)
    assert run.batch  # noqa: S101 - the document has one
    return find_batch_name(open_store(run.store), run.batch)


def _launch(package: str, file: str) -> dict[str, object]:
    return {"application": package, "launchConfig": {"packageName": package, "launchFile": file}}


def failures(case: Case, way: str, opened: OpenBatch, seed: int, episodes: int) -> FailureTraits:
    """Returns all failures that a way of spending episodes meets."""
    near, over = episodes // 4, case.over | (case.shares if way == "search" else {})
    budget, find = SearchBudget(episodes=episodes - near), SearchFind(episodes=near)
    search = Search(over=over, budget=budget, find=find, seed=len(WAYS) * seed + WAYS.index(way))
    steps, random = SearchSteps(opened, search, DrawnEpisodes(opened, search)), np.random.default_rng(search.seed)
    if way == "search":
        steps.estimate()
        steps.explore()
    elif way == "grid":
        steps.scores(grid(case, random, episodes))
    else:
        steps.scores(Particles(random.standard_normal((episodes, len(over))), random.random((episodes, 2))))
    found = steps.traits()
    return found._replace(numbers=found.numbers[:, [name in case.over for name in sorted(over)]])


def grid(case: Case, random: np.random.Generator, episodes: int) -> Particles:
    """Returns some values of each variable, from its least to its largest, in each world with as many drawn seeds.

    They are as likely as each other where the variable is drawn; 1 of 200 is beyond the first, and beyond the last.
    """
    values = [ndtri(np.linspace(0.005, 0.995, case.values))] * len(case.over)
    seeds = episodes // (case.values ** len(case.over) * WORLDS)
    axes = np.meshgrid(*values, (np.arange(WORLDS) + 0.5) / WORLDS, np.arange(seeds), indexing="ij")
    columns = [each.ravel() for each in axes]
    return Particles(np.stack(columns[:-2], 1), np.stack([columns[-2], random.random(len(columns[0]))], 1))


def far_apart(found: FailureTraits) -> int:
    """Returns how many failures, each the farthest from those before it, are at least half a part from each other."""
    found = found._replace(seed=np.zeros_like(found.seed))
    nearest, count = np.full(len(found.reason), np.inf), 0
    while len(nearest) and nearest.max() >= APART:
        nearest = np.minimum(nearest, found.apart(int(nearest.argmax())))
        count += 1
    return count


def table(case: Case, batch: OpenBatch, seeds: int, episodes: int) -> str:
    """Returns, per seed and way, failures and what is counted of them, and how many times as many the search has."""
    rows = [("seed", "way", "failures", *(f"{each}{times}" for each in COUNTED for times in ("", ", of the search")))]
    for seed in range(seeds):
        ours: list[int] = []
        for way in WAYS:
            found = failures(case, way, batch, seed, episodes)
            own = found.cells()
            counts = [len(np.unique(own[:, :OF_PLACE], axis=0)), len(np.unique(own, axis=0)), far_apart(found)]
            ours = ours or counts
            shown = [text for our, each in zip(ours, counts, strict=True) for text in (str(each), _times(our, each))]
            rows.append((str(seed), way, str(len(found.reason)), *shown))
            print(rows[-1], flush=True)
    return markdown(rows)


def _times(ours: int, others: int) -> str:
    return f"{ours / others:.1f} times" if others else "-"


def main() -> None:
    """Prints the table, and puts it into a document if one is named."""
    parser = options(__doc__)
    parser.add_argument("--store", type=Path, required=True, help="a folder that keeps what was simulated")
    parser.add_argument("--case", choices=[*CASES], default="scenario")
    parser.add_argument("--episodes", type=int, default=10_000, help="of each way")
    parser.add_argument("--seeds", type=int, default=1)
    chosen = parser.parse_args()
    prepare_devices()
    opened = load_batch(open_store(chosen.store.absolute().as_uri()), batch(chosen.store))
    rows = table(CASES[chosen.case], opened, chosen.seeds, chosen.episodes)
    show("distinct failures", f"{machine()}\n\n{rows}", chosen.document)


if __name__ == "__main__":
    main()
