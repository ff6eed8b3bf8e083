"""The agents of a demonstration begin when the batch's last episode has ended, and not before."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

import pytest

from flows.batch.batch_steps import AUDIT, EPISODES
from flows.pipeline import pipeline
from flows.pipeline.pipeline import robots_in_reserve
from specs.pipeline.document import PipelineSpec
from tasks.documents.pipeline_file import read_pipeline
from tasks.progress.listener import listen_to_progress, report_progress
from tasks.storage.base.store import Store
from tests.repository import ROOT


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The fleets whose agents were begun."""
    found: list[str] = []

    @contextmanager
    def reserve(_store: Store, section: object) -> Generator[Callable[[], None], None, None]:
        yield lambda: found.append(section.fleet.name)  # type: ignore[attr-defined]

    monkeypatch.setattr(pipeline, "robot_reserve", reserve)
    return found


@pytest.fixture
def spec() -> PipelineSpec:
    """The quickstart."""
    return read_pipeline(ROOT / "examples/quickstart.yaml")


def test_they_begin_when_the_last_episode_has_ended(begun: list[str], spec: PipelineSpec, file_store: Store):
    with robots_in_reserve(spec, file_store):
        report_progress(EPISODES, 383, 384)
        report_progress(AUDIT, 64, 64)
        assert begun == []
        report_progress(EPISODES, 384, 384)

    assert begun == ["couriers"]


def test_whoever_listens_to_progress_hears_of_it(begun: list[str], spec: PipelineSpec, file_store: Store):
    heard: list[tuple[str, int, int]] = []
    with listen_to_progress(lambda *told: heard.append(told)), robots_in_reserve(spec, file_store):
        report_progress(EPISODES, 1, 2)

    assert heard == [(EPISODES, 1, 2)]
    assert begun == []


def test_a_run_whose_batch_has_ended_before_begins_them_itself(begun: list[str], spec: PipelineSpec, file_store: Store):
    with robots_in_reserve(spec, file_store) as begin:
        begin()

    assert begun == ["couriers"]


def test_a_document_without_a_deployment_begins_none(begun: list[str], spec: PipelineSpec, file_store: Store):
    with robots_in_reserve(spec.model_copy(update={"deployment": None}), file_store) as begin:
        report_progress(EPISODES, 1, 1)
        begin()

    assert begun == []
