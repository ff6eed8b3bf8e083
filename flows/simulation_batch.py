"""A robot application driven through worlds, seeds and parameters."""

import time

from prefect import flow

from flows.ending import as_run, ended_well, run_name
from flows.resolving import batch_plan, numbered_finder
from specs.common import OutputLocation
from specs.digests import canonical_document
from specs.episode import EpisodeResult
from specs.errors import DocumentError, StageFailed
from specs.pipeline_requests import batch_request
from specs.pipeline_simulation import SimulationBatch
from tasks.applications.task import unpack_application
from tasks.results.task import write_tables
from tasks.simulate.batch import canceled_chunk, chunks_of, close_batch, open_batch
from tasks.simulate.batch_plan import BatchPlan, episode_count, episodes
from tasks.simulate.preview import engine_plan
from tasks.simulate.resolving import output_location
from tasks.simulate.task import simulate_chunk
from tasks.simulate.versions import batch_metadata
from tasks.storage.opening import open_store, store_id
from tasks.storage.records import JobRecord, is_terminal
from tasks.storage.store import Store
from tasks.watching.task import watched


@flow(name="simulation-batch", flow_run_name=run_name, persist_result=False)
def simulation_batch(
    spec: SimulationBatch,
    worlds: list[str] | None = None,
    store: str | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
) -> JobRecord:
    """Returns the batch, whose ``detail`` says where results and failures lie and what they add up to.

    Args:
        spec: The pipeline's section ``simulationBatch``.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means.
        store: URL of the store; SIMYARD_STORE, else ``.simyard`` in the working directory.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.

    Raises:
        DocumentError: A request cannot be run, or names what does not exist.
        StageFailed: The batch timed out.
    """
    opened = open_store(store)
    plan = batch_plan(spec, worlds or [], opened, numbered_finder(opened, versions))
    location = output_location(spec)

    def work(given: str) -> JobRecord:
        request = batch_request(spec, store_id=store_id(opened), token=given)
        record = open_batch(opened, plan, canonical_document(request), request.clientRequestToken or given)
        if is_terminal(record):
            return ended_well(record)
        return ended_well(_run(opened, record.id, plan, location))

    identity = {"spec": canonical_document(spec), "plan": plan.model_dump(mode="json")}
    return as_run(opened, "simulation-batch", identity, token, work)


def _run(store: Store, batch: str, plan: BatchPlan, location: OutputLocation) -> JobRecord:
    try:
        return _closed(store, batch, plan, location)
    except (DocumentError, StageFailed) as exc:
        close_batch(store, batch, "Failed", {}, str(exc))
        raise


def _closed(store: Store, batch: str, plan: BatchPlan, location: OutputLocation) -> JobRecord:
    results = _simulated(store, batch, plan)
    requests = list(episodes(plan))
    metadata = batch_metadata(engine_plan(requests, plan.lanes).engine)
    detail = write_tables(store.url, batch, requests, results, location=location, metadata=metadata)
    timed_out = any(result.status == "Canceled" for result in results)
    status = "TimedOut" if timed_out else "Completed"
    return close_batch(store, batch, status, {**detail, "metadata": dict(metadata)})


def _simulated(store: Store, batch: str, plan: BatchPlan) -> list[EpisodeResult]:
    """Returns the results of all chunks, in order; chunks that no time is left for are cancelled."""
    deadline_s = time.monotonic() + plan.timeout_s
    folders = {digest: unpack_application(store.url, digest) for digest in plan.digests()}
    results: list[EpisodeResult] = []
    total = episode_count(plan)
    with watched("Episodes", "episodes-progress") as progress:
        for chunk in chunks_of(plan):
            left_s, done = deadline_s - time.monotonic(), len(results)
            progress(done, total)

            def tell(finished: int, done: int = done) -> None:
                progress(done + finished, total)

            if left_s > 0:
                results += simulate_chunk(store.url, batch, chunk.number, bundles=folders, left_s=left_s, progress=tell)
            else:
                results += canceled_chunk(chunk, f"the batch's {plan.timeout_s:.0f} s were over")
        progress(len(results), total)
    return results
