"""A batch, a world generation and an export that a test does again and again, in this process and without Prefect."""

from collections.abc import Callable

from flows.batch.batch_end import close_with_tables
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.export.job.export_job import run_export_job
from tasks.simulate.batch.batch_record import complete
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.worlds.job.generation_job import run_generation_job
from tests.export.export_jobs import ARNS, WORLDS
from tests.export.export_jobs import request as exported
from tests.factories.planned_batches import begun, mixed
from tests.worlds.templates import sample

Work = Callable[[Store, str], JobRecord]
_TEMPLATE: TemplateBody = sample("default-two-rooms")
# What two runs of one piece of work may differ in: who worked on it, when, and how often.
_OWN = ("jobs/", "claims/", "tokens/", "store.json")


def simulate(store: Store, name: str) -> JobRecord:
    """Returns a batch of that name, all of its chunks committed and its tables written."""
    batch = begun(store, name=name)
    record = batch.record()
    if is_terminal(record):
        return record
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, mixed, lanes=batch.plan.lanes, left_s=3600.0)
    complete(batch)
    return close_with_tables(batch)


def generate(store: Store, name: str) -> JobRecord:
    """Returns a job that made a world."""
    request = CreateWorldGenerationJobRequest.model_validate(
        {
            "template": "arn:aws:robomaker:us-west-2:111111111111:world-template/two-rooms",
            "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
        }
    )
    return run_generation_job(store, request, _TEMPLATE, seed=1, token=name, progress=lambda *_: None, workers=1)


def export(store: Store, name: str) -> JobRecord:
    """Returns a job that exported a world as a plan."""
    store.put(world_key(WORLDS[0].generation, WORLDS[0].name), WORLDS[0].model_dump_json().encode())
    request = exported(ARNS[0])
    return run_export_job(store, request, formats=("svg",), token=name, progress=lambda *_: None)


def results(store: Store) -> dict[str, bytes]:
    """Returns all that work has left in a store, but for what tells who did it, and when."""
    keys = [key for key in store.keys("") if not key.startswith(_OWN) and not key.endswith((".started.json", ".html"))]
    return {key: store.get(key).body for key in keys}
