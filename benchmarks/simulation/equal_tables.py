"""Equal tables: the same noisy episodes with several numbers of lanes, in two orders, and the digest of each table.

    .venv/bin/python -m benchmarks.simulation.equal_tables [--lanes N ...] [--engine NAME] [--seeds N] [--document FILE]

The courier delivers at two speeds with wheels that miscount (ODOMETRY_SIGMA 0.3) in four apartments of the quickstart's
template and four offices, whose maps have other sizes. A table is sorted by the episode's number before its digest is
taken, so that equal digests mean that each row is the same in its last bit. The second order is a shuffle of the
episodes and has the worlds the other way round.
"""

import hashlib
import itertools
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.harness import ROOT, markdown, options, show
from specs.base import digest
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.documents.template_source import find_template
from tasks.simulate.devices import prepare_devices
from tasks.simulate.plan.chunks import plan_chunks
from tasks.storage.store_url import open_store
from tasks.worlds.generate import generate_world

TEMPLATES, SEED = ("two-rooms.json", "office.yaml"), 7
FLOORPLANS, INTERIORS = 4, 2
SIGMA, SPEEDS, DURATION_S = "0.3", ("0.4", "0.6"), 60.0
COURIER, DELIVERY = "c" * 64, "d" * 64
FOLDERS = {COURIER: ROOT / "applications/courier", DELIVERY: ROOT / "applications/delivery"}
_ROBOT = ApplicationLaunch(name="courier", version="1", digest=COURIER, package="courier", launch_file="go_to_goal")
_SCENARIO = ApplicationLaunch(name="delivery", version="1", digest=DELIVERY, package="delivery", launch_file="rooms")


class Variant(NamedTuple):
    """Lanes of a chunk, and whether the episodes come in their own order."""

    lanes: int
    ordered: bool


def mixed_worlds(folder: Path) -> dict[str, World]:
    """Returns the worlds by name; each is drawn in milliseconds and the same everywhere."""
    store = open_store(folder.as_uri())
    bodies = [find_template(str(ROOT / "examples/templates" / name), store, ROOT) for name in TEMPLATES]
    indices = [(plan, interior) for plan in range(1, FLOORPLANS + 1) for interior in range(1, INTERIORS + 1)]
    return {
        f"mixed/{plan}-{interior}": generate_world(
            bodies[plan % len(bodies)], seed=SEED, generation="mixed", floorplan_index=plan, interior_index=interior
        )
        for plan, interior in indices
    }


def noisy_deliveries(worlds: Sequence[str], seeds: int) -> list[EpisodeRequest]:
    """Returns an episode for each world, speed and seed, those of a world next to each other, as a batch has them."""
    return [
        EpisodeRequest(
            index=index,
            world=world,
            seed=seed,
            robot=_ROBOT,
            scenario=_SCENARIO,
            environment={"ODOMETRY_SIGMA": SIGMA, "MAX_SPEED": speed},
            duration_s=DURATION_S,
        )
        for index, (world, speed, seed) in enumerate(itertools.product(worlds, SPEEDS, range(seeds)))
    ]


def rows_of(
    requests: Sequence[EpisodeRequest], worlds: Mapping[str, World], variant: Variant, engine: str
) -> list[EpisodeResult]:
    """Returns the rows, sorted by the episodes' numbers."""
    prepare_devices()
    from tasks.simulate.chunk.chunk_simulation import simulate_episodes  # noqa: PLC0415 - JAX reads its settings then

    own, known = list(requests), dict(worlds)
    if not variant.ordered:
        own = [requests[k] for k in np.random.default_rng(18).permutation(len(requests))]
        known = {name: worlds[name] for name in reversed([*worlds])}
    rows: list[EpisodeResult] = []
    for chunk in plan_chunks(own, variant.lanes):
        rows += simulate_episodes(chunk, known, FOLDERS, lanes=variant.lanes, engine=engine, should_stop=lambda: False)
    return sorted(rows, key=lambda row: row.index)


def table_digest(rows: Sequence[EpisodeResult]) -> str:
    """Returns the SHA-256 of the rows, as canonical JSON."""
    return hashlib.sha256("".join(map(digest, rows)).encode()).hexdigest()


def main() -> None:
    """Prints a line for each variant, and what differs from the first."""
    parser = options(__doc__)
    parser.add_argument("--lanes", type=int, nargs="+", default=[16, 32, 192, 768])
    parser.add_argument("--engine", default="planar")
    parser.add_argument("--seeds", type=int, default=48)
    parser.add_argument("--store", type=Path, default=Path(tempfile.gettempdir()) / "simyard-equal-tables")
    asked = parser.parse_args()
    worlds = mixed_worlds(asked.store)
    requests = noisy_deliveries([*worlds], asked.seeds)
    table = [["lanes", "order", "passed", "rows that differ", "outcomes that differ", "SHA-256 of the sorted table"]]
    first: list[EpisodeResult] = []
    for variant in [Variant(lanes, ordered) for lanes in asked.lanes for ordered in (True, False)]:
        start = time.monotonic()
        rows = rows_of(requests, worlds, variant, asked.engine)
        first = first or rows
        differ = sum(one != other for one, other in zip(first, rows, strict=True))
        flips = sum(one.outcome != other.outcome for one, other in zip(first, rows, strict=True))
        table.append(
            [
                str(variant.lanes),
                "given" if variant.ordered else "shuffled",
                str(Counter(row.outcome for row in rows)["Passed"]),
                str(differ),
                str(flips),
                table_digest(rows)[:16],
            ]
        )
        print(" ".join(table[-1]), f"{time.monotonic() - start:.0f} s", flush=True)
    found = f"{len(requests)} episodes, {len(worlds)} worlds, engine {asked.engine}\n\n{markdown(table)}"
    show(f"equal tables {asked.engine}", found, asked.document)


if __name__ == "__main__":
    main()
