"""How many distinct failures a search finds beside plain random draws and a plain grid, with as many episodes each.

    .venv/bin/python -m benchmarks.results.distinct_failures --store FOLDER [--seeds N] [--document FILE]

The courier delivers in two apartments; its speed, the noise of its odometry and its mass vary. Failures of all three
ways are counted alike, in two ways: cells of an archive (reason, world, place to a metre, tenth of each variable's
distribution), and failures of which each is at least half a part from each other one (a part is another reason, another
world, a metre, or all of the variables' distributions; another seed alone makes no other failure). A seed is
30,000 episodes. What was simulated is in the store, and is not simulated again; take another folder after a change.
"""

from pathlib import Path

import numpy as np
from scipy.special import ndtri

import simyard
from benchmarks.harness import ROOT, machine, markdown, options, show
from flows.batch.search_batch import DrawnEpisodes, SearchSteps
from specs.pipeline.search_section import Distribution, Normal, Search, SearchBudget, SearchFind
from tasks.results.statistics.distinct_failures import FailureTraits
from tasks.results.statistics.rare_failures import Particles
from tasks.simulate.batch.batch_record import load_batch
from tasks.simulate.devices import prepare_devices
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records
from tasks.storage.resource_names import find_batch_name
from tasks.storage.store_url import open_store

EPISODES, EXPLORED, WORLDS, VALUES, APART = 10_000, 2_500, 2, 10, 0.5
OVER = {
    "MAX_SPEED": Distribution(uniform=(0.3, 0.8)),
    "ODOMETRY_SIGMA": Distribution(logUniform=(0.01, 0.1)),
    "robot.mass": Distribution(normal=Normal(mean=1.0, sd=0.1, atLeast=0.5, atMost=1.5)),
}
WAYS = ("search", "random draws", "grid")


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


def failures(way: str, store: Store, batch: str, seed: int) -> FailureTraits:
    """Returns all failures that a way of spending episodes meets."""
    budget, find = SearchBudget(episodes=EPISODES - EXPLORED), SearchFind(episodes=EXPLORED)
    search = Search(over=OVER, budget=budget, find=find, seed=len(WAYS) * seed + WAYS.index(way))
    opened = load_batch(store, batch)
    steps, random = SearchSteps(opened, search, DrawnEpisodes(opened, search)), np.random.default_rng(search.seed)
    if way == "search":
        steps.estimate()
        steps.explore()
    elif way == "grid":
        steps.scores(grid(random))
    else:
        steps.scores(Particles(random.standard_normal((EPISODES, len(OVER))), random.random((EPISODES, 2))))
    return steps.traits()


def grid(random: np.random.Generator) -> Particles:
    """Returns ten values of each variable, from its least to its largest, in each world with as many drawn seeds.

    They are as likely as each other where the variable is drawn; 1 of 200 is beyond the first, and beyond the last.
    """
    values = ndtri(np.linspace(0.005, 0.995, VALUES))
    cells = VALUES ** len(OVER) * WORLDS
    worlds = (np.arange(WORLDS) + 0.5) / WORLDS
    axes = np.meshgrid(*[values] * len(OVER), worlds, np.arange(EPISODES // cells), indexing="ij")
    columns = [each.ravel() for each in axes]
    return Particles(np.stack(columns[:-2], 1), np.stack([columns[-2], random.random(len(columns[0]))], 1))


def cells(found: FailureTraits) -> int:
    """Returns how many cells failures are in."""
    return len(np.unique(found.cells(), axis=0))


def far_apart(found: FailureTraits) -> int:
    """Returns how many failures, each the farthest from those before it, are at least half a part from each other."""
    found = found._replace(seed=np.zeros_like(found.seed))
    nearest, count = np.full(len(found.reason), np.inf), 0
    while len(nearest) and nearest.max() >= APART:
        nearest = np.minimum(nearest, found.apart(int(nearest.argmax())))
        count += 1
    return count


def table(store: Store, batch: str, seeds: int) -> str:
    """Returns, per seed and way, the failures, the cells, and those far apart; and how many times the search has."""
    rows = [("seed", "way", "failures", "cells", "search has so many times", "far apart", "search has so many times")]
    for seed in range(seeds):
        counts: dict[str, tuple[int, int]] = {}
        for way in WAYS:
            found = failures(way, store, batch, seed)
            counts[way] = cells(found), far_apart(found)
            (some, few), (ours, own) = counts[way], counts["search"]
            rows.append(
                (str(seed), way, str(len(found.reason)), str(some), _times(ours, some), str(few), _times(own, few))
            )
            print(rows[-1], flush=True)
    return markdown(rows)


def _times(ours: int, others: int) -> str:
    return f"{ours / others:.1f}" if others else "-"


def main() -> None:
    """Prints the table, and puts it into a document if one is named."""
    parser = options(__doc__)
    parser.add_argument("--store", type=Path, required=True, help="a folder that keeps what was simulated")
    parser.add_argument("--seeds", type=int, default=3)
    chosen = parser.parse_args()
    prepare_devices()
    store = open_store(chosen.store.absolute().as_uri())
    rows = table(store, batch(chosen.store), chosen.seeds)
    show("distinct failures", f"{machine()}\n\n{rows}", chosen.document)


if __name__ == "__main__":
    main()
