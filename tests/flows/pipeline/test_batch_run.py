"""What a batch's end imports is imported while its episodes are driven, and what was made ready ends with the batch."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from threading import enumerate as all_threads

import pytest

from flows.pipeline import batch_run
from flows.pipeline.batch_run import prepare_simulation, run_batch
from flows.pipeline.references import ParsedRun, Resolved
from flows.prefect import spread_work
from specs.errors import StageFailed
from specs.field_types import OutputLocation
from tasks.applications.registry import publish_bundle
from tasks.documents.pipeline_file import read_pipeline
from tasks.simulate.batch.batch_record import KIND, OpenBatch
from tasks.simulate.batch.chunk_run import PreparedChunk, prepared_chunk
from tasks.simulate.batch.chunk_store import ChunkNumbers
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.planned_batches import begun as begun_batch
from tests.factories.planned_batches import plan, template
from tests.factories.simulations import COURIER, DELIVERY, FOLDERS, ROBOT, SCENARIO
from tests.repository import ROOT

NOBODYS = "plistlib"  # of the standard library, and imported by nobody here
RESULTS = OutputLocation(s3Bucket="results")


def test_modules_are_imported_and_those_that_are_missing_left_to_who_needs_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(sys.modules, NOBODYS, raising=False)
    monkeypatch.setattr(batch_run, "_NEEDED_AT_THE_END", ("no_such_module", NOBODYS))

    batch_run._import_ahead()  # pyright: ignore[reportPrivateUsage]

    for thread in all_threads():
        if thread.name == "simyard imports":
            thread.join()
    assert NOBODYS in sys.modules


def on_a_worker(batch: OpenBatch) -> None:
    spread_work._simulate_numbers(batch, (0, 1), RESULTS, left_s=3600.0, spent_s=0.0)  # pyright: ignore[reportPrivateUsage]


@pytest.mark.parametrize("run", [lambda batch: batch_run.run_batch(batch.store, batch.id, RESULTS), on_a_worker])
def test_chunks_that_were_made_ready_early_end_with_a_batch_that_breaks_off(
    file_store: Store, monkeypatch: pytest.MonkeyPatch, run: Callable[[OpenBatch], None]
):
    batch, early = begun_batch(file_store, plan(file_store, audit=0)), list[PreparedChunk]()

    def breaks_off(*_: object, **__: object) -> None:
        early.append(prepared_chunk(batch, 1, {}))
        assert prepared_chunk(batch, 1, {}) is early[0]
        raise StageFailed("InternalServiceError", "the store is away")

    for module, name in ((batch_run, "_simulate_here"), (spread_work, "simulate_chunk")):
        monkeypatch.setattr(module, name, breaks_off)
    with pytest.raises(StageFailed, match="the store is away"):
        run(batch)
    assert prepared_chunk(batch, 1, {}) is not early[0]


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """What processes were begun for."""
    found: list[Sequence[str]] = []
    monkeypatch.setattr(batch_run, "begin_simulation_process", lambda _store, digests: found.append([*digests]))
    return found


@pytest.fixture
def run(file_store: Store) -> JobRecord:
    """A run."""
    return submit(file_store, "pipeline-run", {}, "token")


@pytest.fixture
def work(file_store: Store, run: JobRecord) -> ParsedRun:
    """The quickstart, whose batch tests two applications."""
    spec = read_pipeline(ROOT / "examples/quickstart.yaml")
    return ParsedRun(spec, ".", file_store, run, Resolved(batch=plan(file_store)))


def test_it_begins_with_the_applications_that_the_run_has_pinned(begun: list[Sequence[str]], work: ParsedRun):
    prepare_simulation(work)
    assert work.found.batch is not None
    assert begun == [[*work.found.batch.digests()]]


def test_it_does_not_begin_where_the_batch_is_the_first_stage(begun: list[Sequence[str]], work: ParsedRun):
    alone = work.spec.model_copy(update={"worldGeneration": None, "worldExport": None})
    prepare_simulation(replace(work, spec=alone))
    assert not begun


def test_it_does_not_begin_for_a_run_that_goes_on_after_its_batch(begun: list[Sequence[str]], work: ParsedRun):
    batch = submit(work.store, KIND, {}, stage_token(work.run, "batch"))
    for status in ("InProgress", "Completing", "Completed"):
        advance(work.store, KIND, batch.id, status)
    prepare_simulation(work)
    assert not begun


def test_it_does_not_begin_where_workers_of_a_cluster_simulate(
    begun: list[Sequence[str]], work: ParsedRun, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(batch_run.orchestrator(), "wanted_workers", lambda: "dask:2")
    prepare_simulation(work)
    assert not begun


@pytest.fixture
def batch(file_store: Store, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> OpenBatch:
    """A batch that is interrupted when its first chunk is made ready."""
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(batch_run, "_simulate_chunks", interrupted)
    robot = publish_bundle(file_store, "robot-application", "courier", FOLDERS[COURIER])
    scenario = publish_bundle(file_store, "simulation-application", "delivery", FOLDERS[DELIVERY])
    launched = template(
        robot=ROBOT.model_copy(update={"digest": robot.digest}),
        scenario=SCENARIO.model_copy(update={"digest": scenario.digest}),
    )
    return begun_batch(file_store, plan(file_store, templates=(launched,), audit=0))


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The applications of processes that a batch began before it had anything to ask."""
    found: list[list[str]] = []
    monkeypatch.setattr(batch_run, "prepare_simulator", lambda bundles: found.append(list(bundles)))
    return found


def test_a_batch_begins_it_before_its_first_chunk_is_made_ready(batch: OpenBatch, prepared: list[list[str]]):
    with pytest.raises(KeyboardInterrupt):
        run_batch(batch.store, batch.id, OutputLocation(s3Bucket="results"))
    assert prepared == [list(batch.plan.digests())]


def test_a_batch_that_workers_simulate_begins_none_here(
    batch: OpenBatch, prepared: list[list[str]], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(batch_run.orchestrator(), "wanted_workers", lambda: "dask:2")
    with pytest.raises(KeyboardInterrupt):
        run_batch(batch.store, batch.id, OutputLocation(s3Bucket="results"))
    assert not prepared


def test_a_batch_whose_chunks_are_all_there_begins_none(
    batch: OpenBatch, prepared: list[list[str]], monkeypatch: pytest.MonkeyPatch
):
    there = ChunkNumbers(begun=frozenset(), committed=frozenset(range(batch.layout.chunks)))
    monkeypatch.setattr(batch_run, "chunk_numbers", lambda *_: there)
    with pytest.raises(KeyboardInterrupt):
        run_batch(batch.store, batch.id, OutputLocation(s3Bucket="results"))
    assert not prepared


def test_a_batch_whose_applications_are_gone_begins_none_and_goes_on(batch: OpenBatch, prepared: list[list[str]]):
    for digest in batch.plan.digests():
        batch.store.delete(bundle_key(digest))
    with pytest.raises(KeyboardInterrupt):
        run_batch(batch.store, batch.id, OutputLocation(s3Bucket="results"))
    assert not prepared
