"""docs/operate/operations.md on a real PostgreSQL: a schedule that fires, two pipelines at once, a cancellation."""

import json
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import pytest

from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, records
from tasks.storage.store_url import open_store
from tests.integration.runs import ROOT, finished, small_document
from tests.integration.stopped.operated import (
    ENDED,
    asked,
    begun_run,
    commands,
    ended_run,
    environment,
    prefect,
    started,
    until,
    wait_until_healthy,
)
from tests.servers.postgres import running_postgres

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1500)]


@dataclass(frozen=True)
class Operated:
    """What an operator has set up.

    Attributes:
        api_url: Of the server.
        store: That the worker uses.
    """

    api_url: str
    store: Store


@pytest.fixture(scope="module")
def operated(tmp_path_factory: pytest.TempPathFactory) -> Generator[Operated]:
    """A PostgreSQL, a server on it, everything in prefect.yaml deployed, and a worker."""
    folder = tmp_path_factory.mktemp("operated")
    with running_postgres() as port:
        api_url = "http://127.0.0.1:4244/api"
        server = environment(
            "server",
            PREFECT_SERVER_API_PORT="4244",
            PREFECT_API_DATABASE_CONNECTION_URL=f"postgresql+asyncpg://prefect@127.0.0.1:{port}/prefect",
            PREFECT_HOME=str(folder / "server"),
        )
        worker = environment(
            "worker",
            PREFECT_API_URL=api_url,
            PREFECT_HOME=str(folder / "worker"),
            SIMYARD_STORE=(folder / "store").as_uri(),
            SIMYARD_BUCKETS=(folder / "buckets").as_uri(),
            SIMYARD_CACHE=str(folder / "cache"),
            SIMYARD_KEYS="",
        )
        del worker["PREFECT_DEFAULT_RESULT_STORAGE_BLOCK"]  # there is no bucket here
        password = worker["PREFECT_API_AUTH_STRING"]
        with (
            pytest.MonkeyPatch.context() as patch,
            started("simyard-server", server, folder / "server.log") as process,
        ):
            patch.setenv("PREFECT_API_AUTH_STRING", password)
            wait_until_healthy(api_url, process, folder / "server.log")
            for _, *command in commands("docs/operate/operations.md", "deployments"):
                prefect(worker, *command)
            with started("simyard-worker", worker, folder / "worker.log"):
                yield Operated(api_url, open_store(worker["SIMYARD_STORE"]))


def test_what_is_deployed_is_on_postgresql_with_its_fields_in_order(operated: Operated):
    deployed = asked(operated.api_url, "/deployments/filter", {})
    (nightly,) = [each for each in deployed if each["name"] == "nightly"]
    fields = nightly["parameter_openapi_schema"]["definitions"]["PipelineSpec"]["properties"]

    assert [schedule["active"] for schedule in nightly["schedules"]] == [False]
    assert sorted(fields, key=lambda name: fields[name]["position"])[:3] == ["name", "applications", "worldGeneration"]


def test_the_templates_of_the_other_pools_are_taken(operated: Operated):
    for _, *command in commands("docs/operate/operations.md", "pools"):
        prefect({"PREFECT_API_URL": operated.api_url}, *command)

    pools = {pool["name"]: pool for pool in asked(operated.api_url, "/work_pools/filter", {})}
    for name in ("docker", "kubernetes"):
        template = json.loads((ROOT / f"deploy/{name}-pool.json").read_text())
        assert (pools[name]["type"], pools[name]["base_job_template"]) == (name, template)


def test_a_schedule_fires_by_itself_and_its_run_ends(operated: Operated):
    spec = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 99}
    deployment = asked(operated.api_url, "/deployments/name/world-generation/on-demand")
    schedule = {"schedule": {"interval": 30}, "active": True, "parameters": {"spec": spec, "base": "examples"}}
    (made,) = asked(operated.api_url, f"/deployments/{deployment['id']}/schedules", [schedule])
    try:
        run = until(lambda: _scheduled(operated.api_url, deployment["id"]), "the end of a scheduled run")
    finally:
        prefect({"PREFECT_API_URL": operated.api_url}, "deployment", "schedule", "pause", "--all")

    assert run["state_type"] == "COMPLETED", run
    assert made["active"]
    assert 99 in [job.detail["seed"] for job in records(operated.store, "world-generation-job")]


def test_two_pipelines_at_once_share_one_store(operated: Operated):
    documents = [small_document(name=f"at-once-{seed}", gate={"successRate": {"atLeast": 0.01}}) for seed in (101, 102)]
    for document, seed in zip(documents, (101, 102), strict=True):
        document["worldGeneration"] = {**_section(document, "worldGeneration"), "seed": seed}
        document["deployment"] = None
    runs = [begun_run(operated.api_url, "pipeline/nightly", {"spec": each, "base": "examples"}) for each in documents]

    ended = [ended_run(operated.api_url, run) for run in runs]

    assert [run["state_type"] for run in ended] == ["COMPLETED", "COMPLETED"], ended
    starts, ends = [run["start_time"] for run in ended], [run["end_time"] for run in ended]
    assert max(starts) < min(ends), "they did not overlap"
    found = [_run_of(operated.store, f"at-once-{seed}") for seed in (101, 102)]
    assert [run.status for run in found] == ["Completed", "Completed"]


def test_a_batch_that_is_cancelled_by_its_arn_ends_its_run(operated: Operated):
    document = small_document(name="cancelled", deployment=None, gate={"successRate": {"atLeast": 0.5}})
    batch = _section(document, "simulationBatch")
    document["simulationBatch"] = {**batch, "matrix": {"seeds": 5000}, "recordings": {"episodes": "none"}}
    before = {job.id for job in records(operated.store, "simulation-job-batch")}
    run = begun_run(operated.api_url, "pipeline/nightly", {"spec": document, "base": "examples"})

    def going() -> JobRecord | None:
        state = asked(operated.api_url, f"/flow_runs/{run}")
        assert state["state_type"] not in ENDED, state["state"]
        found = [job for job in records(operated.store, "simulation-job-batch") if job.id not in before]
        return next((job for job in found if job.status == "InProgress"), None)

    running = until(going, "a batch in progress")
    done = finished("cancel", running.arn, "--store", operated.store.url)

    assert done.returncode == 0, done.stderr
    assert ended_run(operated.api_url, run)["state_type"] == "CANCELLED"
    (closed,) = [job for job in records(operated.store, "simulation-job-batch") if job.id == running.id]
    assert closed.status == "Canceled"


def _section(document: dict[str, Any], name: str) -> dict[str, Any]:
    return document[name]


def _run_of(store: Store, name: str) -> JobRecord:
    found = [run for run in records(store, "pipeline-run") if name in json.dumps(run.model_dump(mode="json"))]
    return found[0]


def _scheduled(api_url: str, deployment: str) -> dict[str, Any] | None:
    wanted = {"deployment_id": {"any_": [deployment]}, "state": {"type": {"any_": [*ENDED]}}}
    found = asked(api_url, "/flow_runs/filter", {"flow_runs": wanted})
    return next((run for run in found if run["auto_scheduled"]), None)
