"""What Prefect's server has of a run: its tag, names, log lines, keys and assets, each once."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read, records
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.store_url import open_store
from tests.integration.prefect_features.test_automations import python
from tests.integration.runs import ROOT
from tests.integration.stopped.operated import asked, until

pytestmark = pytest.mark.integration

DOCUMENT = "apartment-regression"
EXPORT = ["the world export begins", "the world export is Completed"]
MATERIALIZED = "prefect.asset.materialization.succeeded"
# As a run that is continued tells of what it has made already; then of something new, so that one sees both arrive.
AGAIN = """
import sys
from prefect import flow
from flows.prefect.prefect_events import announce_asset
from flows.pipeline.stage_report import Asset, MadeAsset, made_by
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store

@flow
def again(store: str, job: str) -> None:
    announce_asset(made_by(open_store(store), read(open_store(store), "world-generation-job", job)))
    announce_asset(MadeAsset(Asset(f"{store}/last", "last"), (), {}))

again(*sys.argv[1:])
"""
ALONE = """
import sys
from flows.prefect.flows import world_generation
from specs.pipeline.world_sections import WorldGeneration

section = {"template": "two-rooms.json", "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1}, "seed": 3}
world_generation(WorldGeneration.model_validate(section), store=sys.argv[1], base=sys.argv[2])
"""


@pytest.fixture
def store(small_run: Path) -> Store:
    return open_store((small_run / ".simyard").as_uri())


@pytest.fixture
def run(store: Store) -> JobRecord:
    """Returns the run of the small document, which other tests may have run again."""
    return min(records(store, "pipeline-run"), key=lambda run: run.created_at_s)


@pytest.fixture
def flow_runs(prefect_server: str, run: JobRecord) -> dict[str, str]:
    """Returns the ids of the flow runs that have the run's tag, by name."""
    found = asked(prefect_server, "/flow_runs/filter", {"flow_runs": {"tags": {"all_": [run.id]}}})
    return {each["name"]: each["id"] for each in found}


def test_all_flow_runs_of_a_run_have_its_tag_and_names_that_say_what_they_are(flow_runs: dict[str, str]):
    stages = {f"{DOCUMENT}-{stage}" for stage in ("worlds", "export", "batch", "deployment")}
    assert set(flow_runs) == {DOCUMENT, *stages}


def test_task_runs_are_named_by_what_they_do(prefect_server: str, flow_runs: dict[str, str]):
    wanted = {"task_runs": {"flow_run_id": {"any_": [*flow_runs.values()]}}}
    names = {each["name"] for each in asked(prefect_server, "/task_runs/filter", wanted)}
    assert {"worlds 1-2", "contact sheet", "export 2 worlds", "unpack courier", "unpack delivery"} <= names
    assert {"chunk 1 of 2", "chunk 2 of 2", "tables", "audit", "judge", "roll out to couriers"} <= names


def test_the_log_of_a_run_tells_its_story_in_some_20_lines(
    prefect_server: str, store: Store, run: JobRecord, flow_runs: dict[str, str]
):
    lines = until(lambda: _ended(_our_lines(prefect_server, flow_runs[DOCUMENT])))

    told = [line.split(" after ")[0].partition(" says ")[0] for line in lines]
    assert [line for line in told if line not in EXPORT] == [
        f"{run.arn} is Running",
        "the world generation begins",
        "the world generation is Completed",
        "the simulation batch begins",
        "the simulation batch is Completed",
        "the gate begins",
        f"the gate of {run.arn}",
        "the deployment begins",
        "the deployment is Succeeded",
        f"{run.arn} is Completed",
    ]
    # Worlds are exported while the batch runs: only what needs both is told after both.
    assert [line for line in told if line in EXPORT] == EXPORT
    assert told.index("the world generation is Completed") < told.index(EXPORT[0])
    assert told.index(EXPORT[1]) < told.index("the gate begins")
    in_all = [line for each in flow_runs.values() for line in _our_lines(prefect_server, each)]
    jobs = [read(store, kind, job).arn for kind, job in jobs_of(run)]
    assert [job for job in jobs if not any(line.startswith(f"{job} is ") for line in in_all)] == []
    assert 15 <= len(in_all) <= 25


def test_every_artifact_of_a_run_has_its_documents_name_in_its_key(prefect_server: str, flow_runs: dict[str, str]):
    wanted = {"artifacts": {"flow_run_id": {"any_": [*flow_runs.values()]}}}
    keys = {each["key"] for each in asked(prefect_server, "/artifacts/filter", wanted) if each["key"]}
    assert len(keys) > 10
    assert {key.partition("--")[0] for key in keys} == {DOCUMENT}


def test_what_a_run_made_is_there_with_what_it_was_made_of(prefect_server: str, store: Store, run: JobRecord):
    jobs = {kind: read(store, kind, job) for kind, job in jobs_of(run)}
    batch = jobs["simulation-job-batch"]
    worlds, zipped = f"{store.url}/worlds/{jobs['world-generation-job'].id}", jobs["world-export-job"].detail["zip"]
    tables, evidence = batch.detail["results_url"], f"{store.url}/results/{batch.id}/evidence.json"
    roll_out = f"{store.url}/jobs/deployment-job/{jobs['deployment-job'].id}.json"

    made = until(lambda: _all_of(_made(prefect_server), worlds, zipped, tables, evidence, roll_out))

    courier, delivery = (source for source in _sources(made[tables]) if source.startswith(f"{store.url}/bundles/"))
    assert _sources(made[worlds]) == []
    assert _sources(made[zipped]) == [worlds]
    assert _sources(made[tables]) == [worlds, courier, delivery]
    assert _sources(made[evidence]) == [tables]
    assert _sources(made[roll_out]) == [courier, evidence]
    assert made[evidence]["payload"]["verdict"] == "PASS"


@pytest.mark.long
def test_an_asset_that_is_told_again_is_there_once(prefect_server: str, store: Store, run: JobRecord):
    (job,) = (job for kind, job in jobs_of(run) if kind == "world-generation-job")

    python(AGAIN, store.url, job)

    until(lambda: f"{store.url}/last" in _made(prefect_server))
    counted = Counter(each["resource"]["prefect.resource.id"] for each in _asset_events(prefect_server))
    assert counted[f"{store.url}/worlds/{job}"] == 1


@pytest.mark.long
def test_a_stage_alone_has_its_tag_its_name_and_only_its_jobs_events(prefect_server: str, tmp_path: Path):
    url = (tmp_path / "store").as_uri()
    python(ALONE, url, str(ROOT / "examples/templates"))
    (run,), (job,) = (records(open_store(url), kind) for kind in ("pipeline-run", "world-generation-job"))
    about = {"filter": {"resource": {"id": [job.arn, run.arn]}, "order": "ASC"}, "limit": 50}

    def told() -> list[str] | None:
        found = [each["event"] for each in asked(prefect_server, "/events/filter", about)["events"]]
        return found if "simyard.world-generation.Completed" in found else None

    assert until(told) == ["simyard.world-generation.Running", "simyard.world-generation.Completed"]
    (alone,) = asked(prefect_server, "/flow_runs/filter", {"flow_runs": {"tags": {"all_": [run.id]}}})
    assert alone["name"] == "world-generation"
    wanted = {"artifacts": {"flow_run_id": {"any_": [alone["id"]]}}}
    keys = {each["key"] for each in asked(prefect_server, "/artifacts/filter", wanted) if each["key"]}
    assert keys == {"world-generation--worlds", "world-generation--worlds-progress"}


def _our_lines(api_url: str, flow_run: str) -> list[str]:
    body = {"logs": {"flow_run_id": {"any_": [flow_run]}}, "sort": "TIMESTAMP_ASC", "limit": 200}
    return [each["message"] for each in asked(api_url, "/logs/filter", body) if not each["name"].startswith("prefect")]


def _ended(lines: list[str]) -> list[str] | None:
    return lines if lines and lines[-1].endswith(" is Completed") else None


def _asset_events(api_url: str) -> list[dict[str, Any]]:
    page = asked(api_url, "/events/filter", {"filter": {"event": {"name": [MATERIALIZED]}}, "limit": 50})
    found: list[dict[str, Any]] = page["events"]
    while page["next_page"]:
        page = asked(api_url, page["next_page"].removeprefix(api_url))
        found += page["events"]
    return found


def _made(api_url: str) -> dict[str, dict[str, Any]]:
    return {each["resource"]["prefect.resource.id"]: each for each in _asset_events(api_url)}


def _all_of(made: dict[str, dict[str, Any]], *keys: object) -> dict[Any, dict[str, Any]] | None:
    return made if made.keys() >= {*keys} else None


def _sources(event: dict[str, Any]) -> list[str]:
    return [each["prefect.resource.id"] for each in event["related"] if each["prefect.resource.role"] == "asset"]
