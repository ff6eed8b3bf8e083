"""Nights in a store, with tables, without a simulator: a document's runs that ended, each with its batch."""

from collections.abc import Mapping
from pathlib import Path

from pydantic import JsonValue

from specs.data.episode import EpisodeResult
from tasks.simulate.batch.chunk_run import ChunkPart
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.episodes import collided, passed
from tests.factories.judged_batches import courier, delivery, ended


def stored_night(
    store: Store, folder: Path, number: int, failures: int = 2, *, document: str = "nightly", same_as: int | None = None
) -> tuple[JobRecord, JobRecord]:
    """Returns an ended run and its batch of 80 episodes in two worlds.

    Args:
        store: Where they are.
        folder: For the bundle of the robot application, which is another one each night.
        number: Of the night.
        failures: How many episodes collide.
        document: The document's name.
        same_as: The night whose document and references this one has, too.
    """

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        part.watch()
        return [(collided if each.index < failures else passed)(each.index) for each in part.chunk.requests]

    version = number if same_as is None else same_as
    pins: Mapping[str, JsonValue] = {"batch": {"bundle": version}}
    spec: Mapping[str, JsonValue] = {"name": document, "simulationBatch": {"matrix": {"seeds": 40}}}
    run = submit(
        store, "pipeline-run", {"flow": "pipeline", "spec": {**spec}, "pins": {**pins}}, f"{document}-{number}"
    )
    robot, scenario = courier(store, folder, f"v{version}"), delivery(store, folder)
    sweep: dict[str, tuple[str, ...]] = {"MAX_SPEED": ("0.4", "0.6")}
    batch = ended(
        store,
        robot,
        scenario=scenario,
        simulate=simulate,
        name=stage_token(run, "batch"),
        sweep=sweep,
        seeds=tuple(range(20)),
    )
    return advance(store, "pipeline-run", run.id, "Completed"), batch
