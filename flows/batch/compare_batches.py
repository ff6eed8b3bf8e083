"""`simyard compare`: two batches over the episodes that they have in common."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from jaxtyping import Float

from flows.batch.replay_episode import bundles
from flows.batch.world_identity import world_identities
from specs.arn import arn, store_id_of
from specs.errors import DocumentError
from specs.field_types import OutputLocation
from tasks.applications.versions import read_application
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.results.batch_comparison import (
    CommonEpisodes,
    EpisodeFlip,
    FlipPaths,
    ambiguous_versions,
    compare_tables,
    flip_map_svg,
    version_rows,
    versions_driven,
)
from tasks.results.tables.result_files import RESULTS_FILE, recorded_samples, stored_rows
from tasks.simulate.batch.batch_record import KIND, OpenBatch, load_batch
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.simulate.replay.replay_run import replay
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_batch_name
from tasks.storage.worlds import read_world

# Nobody looks at more, and each way that was not recorded costs a simulation.
MAPS_AT_MOST = 12
WAYS_A_MAP = 6
_Way = Float[np.ndarray, "samples 2"]


class ComparedBatch(NamedTuple):
    """A batch that has its tables, and the rows of its results.

    Attributes:
        name: Its id; with the version behind it, ``<id>@<version>``, if one was picked.
        rows: Of that version alone, in the order of their indices.
    """

    work: OpenBatch
    location: OutputLocation
    rows: pa.Table
    name: str

    def job(self, index: int) -> str:
        """Returns the ARN of one of its jobs."""
        return arn("simulation-job", store_id_of(self.work.record().arn), f"{self.work.id}/{index}")


class FlipMap(NamedTuple):
    """A drawing of flips in one world."""

    world: str
    svg: str


def find_batch(store: Store, text: str) -> ComparedBatch:
    """Returns a batch, by its ARN or id, or that of one of its jobs or of the run of its document.

    Of a batch that drove several versions of an application, the episodes of one are meant: ``<batch>@<version>``.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: The text names no batch, or one that has not left its tables yet; or the batch drove several
            versions, and the text names none or another one.
        StageFailed: Its results are not what it wrote.
    """
    named, at, version = text.partition("@")
    work = load_batch(store, find_batch_name(store, named))
    record = work.record()
    if "results_url" not in record.detail:
        allowed = f"a batch that has its tables; this one is {record.status}"
        raise DocumentError.of(KIND, work.id, allowed, source="simyard")
    location = recorded_location(record)
    written = cast("dict[str, str]", record.detail["sha256s"])[RESULTS_FILE]
    rows = stored_rows(store, location, work.id, RESULTS_FILE, sha256=written)
    if at:
        return ComparedBatch(work, location, _picked(store, work.id, rows, version), f"{work.id}@{version}")
    return ComparedBatch(work, location, _unambiguous(work.id, rows), work.id)


def _picked(store: Store, batch: str, rows: pa.Table, version: str) -> pa.Table:
    """Returns the rows of one version, named as the batch asked for it, by its number, or by its digest."""
    driven = versions_driven(rows)
    found = version_rows(rows, version, _numbered_digests(store, driven, version))
    if not found.num_rows:
        asked = sorted({label for versions in driven.values() for label in versions.values()})
        allowed = f"a version that this batch drove: {', '.join(asked)}; or the beginning of a bundle's digest"
        raise DocumentError.of(KIND, f"{batch}@{version}", allowed, source="simyard")
    return _unambiguous(batch, found)


def _numbered_digests(store: Store, applications: Iterable[str], number: str) -> set[str]:
    """Returns the digests of the bundles that a version's number stands for, in any of some robot applications."""
    found = [read_application(store, "robot-application", name) for name in applications]
    versions = [version for each in found if each for version in each.versions if str(version.number) == number]
    return {digest for version in versions for digest in (version.digest, *(each.digest for each in version.builds))}


def _unambiguous(batch: str, rows: pa.Table) -> pa.Table:
    """Returns the rows, which are of one version of each application: others would be paired by their turn."""
    several = ambiguous_versions(versions_driven(rows))
    if several:
        which = " or ".join(f"{batch}@{each}" for each in several)
        allowed = f"one version of an application; this batch drove several, so name one: {which}"
        raise DocumentError.of(KIND, batch, allowed, source="simyard")
    return rows


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
        value = f"{first.name} and {second.name} ({'; '.join(why)})"
        raise DocumentError.of(KIND, value, allowed, source="simyard")
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
    row = batch.rows.filter(pc.field("index") == index)
    recording, engine = (str(row.column(name)[0]) for name in ("recording", "engine"))
    if recording:
        samples = recorded_samples(work.store, batch.location, work.id, recording, index)
        return np.stack([samples.column(name).to_numpy() for name in ("x_m", "y_m")], axis=1)
    steps = replay(work, index, bundles(work), engine=engine).driven.steps
    return None if steps is None else np.asarray(steps["pose"])[:, :2]
