"""The process that simulates begins before the worlds are made, where there is going to be something to simulate."""

from collections.abc import Sequence

import pytest

from flows.stage import stages
from flows.stage.stages import prepare_simulation
from specs.pipeline.document import PipelineSpec
from tasks.documents.pipeline_file import read_pipeline
from tasks.simulate.batch.job import KIND
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.repository import ROOT

DIGESTS = ["a" * 64, "b" * 64]


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """What processes were begun for."""
    found: list[Sequence[str]] = []
    monkeypatch.setattr(stages, "begin_simulation_process", lambda _store, digests: found.append(digests))
    return found


@pytest.fixture
def run(file_store: Store) -> JobRecord:
    """A run whose batch tests two applications."""
    return submit(file_store, "pipeline-run", {"pins": {"batch": {"bundles": [*DIGESTS]}}}, "token")


@pytest.fixture
def spec() -> PipelineSpec:
    """The quickstart."""
    return read_pipeline(ROOT / "examples/quickstart.yaml")


def test_it_begins_with_the_applications_that_the_run_has_pinned(
    begun: list[Sequence[str]], spec: PipelineSpec, file_store: Store, run: JobRecord
):
    prepare_simulation(spec, file_store, run)
    assert begun == [DIGESTS]


def test_it_does_not_begin_where_the_batch_is_the_first_stage(
    begun: list[Sequence[str]], spec: PipelineSpec, file_store: Store, run: JobRecord
):
    alone = spec.model_copy(update={"worldGeneration": None, "worldExport": None})
    prepare_simulation(alone, file_store, run)
    assert not begun


def test_it_does_not_begin_for_a_run_that_goes_on_after_its_batch(
    begun: list[Sequence[str]], spec: PipelineSpec, file_store: Store, run: JobRecord
):
    batch = submit(file_store, KIND, {}, stage_token(run, "batch"))
    for status in ("InProgress", "Completing", "Completed"):
        advance(file_store, KIND, batch.id, status)
    prepare_simulation(spec, file_store, run)
    assert not begun


def test_it_does_not_begin_where_workers_of_a_cluster_simulate(
    begun: list[Sequence[str]],
    spec: PipelineSpec,
    file_store: Store,
    run: JobRecord,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(stages.orchestrator(), "wanted_workers", lambda: "dask:2")
    prepare_simulation(spec, file_store, run)
    assert not begun
