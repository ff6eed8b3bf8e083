"""`simyard compare`: two batches over the episodes that they have in common."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
import pyarrow as pa
from jaxtyping import Float

from flows.batch.replay_episode import bundles
from flows.gate.equal_worlds import world_identities
from specs.base import Fault
from specs.errors import DocumentError
from specs.field_types import OutputLocation
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.results.compare.comparison import CommonEpisodes, EpisodeFlip, compare_tables
from tasks.results.compare.comparison_svg import FlipPaths, flip_map_svg
from tasks.results.tables.result_files import RESULTS_FILE
from tasks.results.tables.stored_rows import recorded_samples, stored_rows
from tasks.simulate.batch.job import KIND, OpenBatch, load_batch
from tasks.simulate.plan.request import recorded_location
from tasks.simulate.replay.replay import replay
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_batch_name
from tasks.storage.worlds import read_world

# Nobody looks at more, and each way that was not recorded costs a simulation.
MAPS_AT_MOST = 12
WAYS_A_MAP = 6
_Way = Float[np.ndarray, "samples 2"]


class ComparedBatch(NamedTuple):
    """A batch that has its tables, and the rows of its results."""

    work: OpenBatch
    location: OutputLocation
    rows: pa.Table


class FlipMap(NamedTuple):
    """A drawing of flips in one world."""

    world: str
    svg: str


def find_batch(store: Store, text: str) -> ComparedBatch:
    """Returns a batch, by its ARN or id, or that of one of its jobs or of the run of its document.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: The text names no batch, or one that has not left its tables yet.
        StageFailed: Its results are not what it wrote.
    """
    work = load_batch(store, find_batch_name(store, text))
    record = work.record()
    if "results_url" not in record.detail:
        allowed = f"a batch that has its tables; this one is {record.status}"
        raise DocumentError([Fault(path=KIND, value=work.id, allowed=allowed)], source="simyard")
    location = recorded_location(record)
    written = cast("dict[str, str]", record.detail["sha256s"])[RESULTS_FILE]
    return ComparedBatch(work, location, stored_rows(store, location, work.id, RESULTS_FILE, sha256=written))


def common_episodes(first: ComparedBatch, second: ComparedBatch) -> CommonEpisodes:
    """Returns the episodes that two batches have in common.

    Raises:
        DocumentError: They have none.
    """
    worlds, others = (world_identities(each.work.store, each.work.plan.worlds_used()) for each in (first, second))
    pairs = compare_tables(first.rows, second.rows, worlds, others)
    if not pairs.pairs:
        allowed = "batches with episodes in common: the same worlds, seeds, environments and applications"
        why = ["all that both have were canceled"] if pairs.canceled else pairs.apart or pairs.origins
        value = f"{first.work.id} and {second.work.id} ({'; '.join(why)})"
        raise DocumentError([Fault(path=KIND, value=value, allowed=allowed)], source="simyard")
    return pairs


def flip_maps(first: ComparedBatch, second: ComparedBatch, flips: Sequence[EpisodeFlip]) -> Iterator[FlipMap]:
    """Yields a drawing for each world with flips, those that have most of them first, at most so many.

    Ways come from recordings where there are any; others are simulated once more.
    """
    by_world: dict[str, list[EpisodeFlip]] = {}
    for flip in flips:
        by_world.setdefault(flip.world, []).append(flip)
    # Python's sort keeps the order of worlds with as many.
    for world, found in sorted(by_world.items(), key=lambda item: -len(item[1]))[:MAPS_AT_MOST]:
        ways = [FlipPaths(each, _way(first, each.first), _way(second, each.second)) for each in found[:WAYS_A_MAP]]
        plan = floor_plan_svg(read_world(second.work.store, world, "simyard compare"))
        yield FlipMap(world, flip_map_svg(plan, ways))


def _way(batch: ComparedBatch, index: int) -> _Way | None:
    work = batch.work
    recording, engine = (str(batch.rows.column(name)[index]) for name in ("recording", "engine"))
    if recording:
        samples = recorded_samples(work.store, batch.location, work.id, recording, index)
        return np.stack([samples.column(name).to_numpy() for name in ("x_m", "y_m")], axis=1)
    steps = replay(work, index, bundles(work), engine=engine).driven.steps
    return None if steps is None else np.asarray(steps["pose"])[:, :2]
