"""`simyard replay`: an episode simulated once more, compared with what was recorded of it, and drawn."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import pyarrow as pa

from specs.base import Fault
from specs.data.episode import reason
from specs.data.world import World
from specs.errors import DocumentError
from specs.field_types import OutputLocation
from tasks.applications.registry import unpack
from tasks.results.playback.deviations import ColumnDeviation, recording_deviations, row_deviations
from tasks.results.playback.playback import Playback, Sight
from tasks.results.tables.recordings import recording_table
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE
from tasks.results.tables.stored_rows import changed_tables, recorded_samples, stored_rows
from tasks.ros.bag.message_log import MessageLog
from tasks.simulate.batch.job import OpenBatch, job_of
from tasks.simulate.batch.provenance import batch_metadata, recorded_machines, this_machine
from tasks.simulate.plan.request import recorded_location
from tasks.simulate.replay.replay import Replay, replay
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.resource_names import find_resource


class JobReplay(NamedTuple):
    """An episode simulated once more.

    Attributes:
        job: ``<batch>/<index>``.
        world: Where it took place.
        ending: How it ended, in a word or two.
        deviations: Each column that was recorded, beside the replay's.
        causes: What is not as it was when it was recorded, and may have changed a number.
        playback: What the robot did; None for an episode that could not start.
        robot: Folder of the robot's bundle on this machine.
        traffic: What its robot and its ROS nodes said to each other; None where there were none.
    """

    job: str
    world: World
    ending: str
    deviations: tuple[ColumnDeviation, ...]
    causes: tuple[str, ...]
    playback: Playback | None
    robot: Path
    traffic: MessageLog | None

    @property
    def same(self) -> bool:
        """Returns whether nothing deviates, not in the last bit."""
        return all(each.same for each in self.deviations)


def replay_job(store: Store, text: str) -> JobReplay:
    """Returns a simulation job, by its ARN or ``<batch>/<index>``, simulated once more.

    Raises:
        ResourceNotFound: There is no such job, or what it needs is gone.
        DocumentError: The text names no job, or one that has not come to an end of its own.
    """
    batch, index = job_of(store, find_resource(store, text, ("simulation-job",)).path)
    record = batch.record()
    location = recorded_location(record)
    recorded = _recorded_row(batch, record, location, index)
    folders = bundles(batch)
    again = replay(batch, index, folders, engine=str(recorded.column("engine")[0]))
    return JobReplay(
        job=f"{batch.id}/{index}",
        world=again.world,
        ending=reason(again.driven.row) or again.driven.row.outcome,
        deviations=(
            *row_deviations(recorded, batch.id, again.request, again.driven.row),
            *_in_recording(batch, location, recorded, again),
        ),
        causes=(*_tables_changed(batch, record, location), *_causes(record, recorded, again)),
        playback=playback(batch.id, again),
        robot=folders[again.request.robot.digest],
        traffic=again.driven.traffic,
    )


def bundles(batch: OpenBatch) -> dict[str, Path]:
    """Returns the folders of a batch's applications on this machine, by digest."""
    return {digest: unpack(batch.store, digest, cache_folder() / "bundles") for digest in batch.plan.digests()}


def playback(batch_id: str, again: Replay) -> Playback | None:
    """Returns what the robot did in a replay; None for an episode that could not start."""
    row, setting, steps = again.driven.row, again.driven.setting, again.driven.steps
    if setting is None or steps is None:
        return None
    return Playback(
        job=f"{batch_id}/{row.index}",
        ending=reason(row) or row.outcome,
        goals_m=setting.goals_m,
        arrived_m=setting.arrived_m,
        radius_m=setting.radius_m,
        heights_m=setting.heights_m,
        sight=Sight(setting.mount, setting.lidar_height_m, setting.range_m, setting.angles_rad),
        t_s=steps["t_s"],
        pose=steps["pose"],
        velocity=steps["velocity"],
        goal_index=steps["goal_index"],
        acted=np.asarray(steps["acted"], bool),
        control=steps["control"],
        ranges_m=steps["ranges_m"],
        impulse_ns=steps["impulse_ns"],
    )


def _recorded_row(batch: OpenBatch, record: JobRecord, location: OutputLocation, index: int) -> pa.Table:
    if "results_url" not in record.detail:
        raise _refused(batch, index, f"a job of a batch that has its tables; this one is {record.status}")
    row = stored_rows(batch.store, location, batch.id, RESULTS_FILE, index=index)
    passed = row.column("success").to_pylist()[0]
    if passed is None:
        raise _refused(
            batch, index, "a job that came to its end; this one was canceled, so there is nothing to compare"
        )
    return row if passed else stored_rows(batch.store, location, batch.id, FAILURES_FILE, index=index)


def _in_recording(
    batch: OpenBatch, location: OutputLocation, recorded: pa.Table, again: Replay
) -> list[ColumnDeviation]:
    name = str(recorded.column("recording")[0])
    if not name:
        return []
    before = recorded_samples(batch.store, location, batch.id, name, again.request.index)
    after = before.slice(0, 0) if again.driven.samples is None else recording_table(again.driven.samples)
    return recording_deviations(before, after)


def _tables_changed(batch: OpenBatch, record: JobRecord, location: OutputLocation) -> list[str]:
    """Returns which of the batch's tables were changed since it wrote them: the row may be what somebody made of it."""
    sha256s = cast("Mapping[str, str]", record.detail.get("sha256s", {}))
    return changed_tables(batch.store, location, batch.id, sha256s, (RESULTS_FILE, FAILURES_FILE))


def _causes(record: JobRecord, recorded: pa.Table, again: Replay) -> Iterator[str]:
    """Yields what is not as it was, from the batch's record, its row, and what is here."""
    before = cast("Mapping[str, str]", record.detail.get("metadata", {}))
    now = batch_metadata(int(before.get("lanes", 0)))
    for package in now:
        if package != "lanes" and before.get(package, now[package]) != now[package]:
            yield f"{package} was {before[package]}, and is {now[package]}"
    for name in ("engine", "device"):
        was, is_now = str(recorded.column(name)[0]), str(getattr(again.driven.row, name))
        if was != is_now:
            yield f"the {name} was {was or 'none'}, and is {is_now or 'none'}"
    names, here = recorded_machines(record), this_machine()
    if names and here not in names:
        yield f"it ran on {' and '.join(names)}, and this is {here}"


def _refused(batch: OpenBatch, index: int, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="simulation-job", value=f"{batch.id}/{index}", allowed=allowed)], "simyard")
