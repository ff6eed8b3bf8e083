"""The failures that a search has found as a document: its batch gives the same failures, bit for bit."""

from pathlib import Path

import pytest
import yaml

from flows.batch.replay_episode import bundles
from flows.batch.search_batch import found_request, search_batch
from flows.batch.suite import regression_suite
from flows.pipeline.references import finder
from flows.pipeline.tested_batch import batch_plan
from specs.data.episode import reason
from specs.data.people import People
from specs.errors import DocumentError
from specs.pipeline.search_section import Distribution, Search, SearchBudget, SearchFind
from tasks.documents.pipeline_file import read_pipeline
from tasks.results.statistics.failure_causes import FailureCauses
from tasks.results.statistics.found_failures import BatchSearch, FoundFailure, write_search
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.rare_failures import FailureProbability
from tasks.simulate.batch.batch_record import OpenBatch, load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkRunner
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.replay.replay_run import resimulate
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.factories.batches import closed_batch, pushing_plan
from tests.factories.planned_batches import request


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return open_store((tmp_path / "store").as_uri())


@pytest.fixture
def batch(store: Store) -> OpenBatch:
    plan = pushing_plan(store)
    return load_batch(store, open_batch(store, plan, request(plan), "tok").id)


def searched(batch: OpenBatch, **physics: str) -> BatchSearch:
    """Returns what a search could have found: two failures, and one that vanished."""
    first, second = batch.plan.worlds[:2]
    failed = FoundFailure(
        world=first, seed=3, environment={"FAULT": "0.5", **physics}, reason="collision", replayed="collision",
        reference="stuck", alike=3,
    )  # fmt: skip
    found = BatchSearch(
        batch=batch.id,
        search=Search(over={"FAULT": Distribution(uniform=(0.0, 1.0))}),
        probability=FailureProbability(
            estimate=0.1,
            interval=Interval(lower=0.05, upper=0.2),
            highest=0.2,
            method="draws",
            why="it is",
            episodes=1000,
        ),
        failures=(failed, failed.model_copy(update={"world": second, "seed": 2**32 - 1})),
        vanished=(failed.model_copy(update={"seed": 4, "reference": ""}),),
        causes=FailureCauses(why="too few"),
        failed=6,
    )
    write_search(batch.store, found)
    return found


def test_each_confirmed_failure_is_a_request_with_its_world_seed_and_variables(batch: OpenBatch, tmp_path: Path):
    found = searched(batch)
    suite = regression_suite(batch.store, batch.id)
    file = tmp_path / "suite.yaml"
    file.write_text(suite.text())
    assert yaml.safe_load(file.read_text()) == suite.document
    section = read_pipeline(file).simulationBatch
    assert section
    plan = batch_plan(section, [], batch.store, finder(batch.store, {}))
    first = [*Layout(plan).requests()]
    assert [(each.world, each.seed, each.environment) for each in first] == [
        (each.world, each.seed, {"GOALS": "1", **each.environment}) for each in found.failures
    ]
    assert {(each.robot, each.scenario, each.duration_s) for each in first} == {
        (asked.robot, asked.scenario, asked.duration_s) for asked in [batch.layout.request(0)]
    }
    assert "# 2: collision in " in suite.text()


def test_its_requests_say_how_late_commands_are_and_what_people_are_like(store: Store, tmp_path: Path):
    plan = pushing_plan(store, people=People(count=4))
    batch = load_batch(store, open_batch(store, plan, request(plan), "people").id)
    own = {"robot.controlDelay_s": "0.15", "people.count": "2", "people.unaware": "0.123456789"}
    found = searched(batch, **own)
    file = tmp_path / "suite.yaml"
    file.write_text(regression_suite(store, batch.id).text())
    section = read_pipeline(file).simulationBatch
    assert section
    again = [*Layout(batch_plan(section, [], store, finder(store, {}))).requests()]
    wanted = [found_request(batch, each) for each in found.failures]
    assert [(each.environment, each.people) for each in again] == [(each.environment, each.people) for each in wanted]
    assert all(own.items() <= each.environment.items() for each in again)


def test_a_batch_that_nobody_searched_has_none(batch: OpenBatch):
    with pytest.raises(DocumentError, match="a section search that found a failure"):
        regression_suite(batch.store, batch.id)


@pytest.mark.long
def test_its_batch_fails_again_in_the_same_bits(batch: OpenBatch, tmp_path: Path):
    search = Search(over={}, budget=SearchBudget(episodes=1_000), find=SearchFind(distinct=6))
    found = search_batch(batch.store.url, batch.id, search).found
    write_search(batch.store, found)
    assert {each.reason for each in found.failures} >= {"collision", "timeout"}
    file = tmp_path / "suite.yaml"
    file.write_text(regression_suite(batch.store, batch.id).text())
    section = read_pipeline(file).simulationBatch
    assert section
    suite = closed_batch(batch.store, batch_plan(section, [], batch.store, finder(batch.store, {})), "suite")
    rows = [row for chunk in range(suite.layout.chunks) for row in committed_chunk(suite.store, suite.id, chunk) or ()]
    # Of one that failed by the measure alone, the row says that it passed.
    assert [reason(row) or found.search.measure for row in rows] == [each.reason for each in found.failures]
    runner = ChunkRunner(bundles(batch), batch.plan.engine, 1.0, lambda _: None)
    asked = [found_request(batch, each).model_copy(update={"index": at}) for at, each in enumerate(found.failures)]
    again = resimulate(batch, asked, runner.run)
    assert [row.model_copy(update={"recording": ""}) for row in rows] == again
