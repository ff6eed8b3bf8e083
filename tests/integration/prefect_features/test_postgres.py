"""docs/operate/operations.md on a real PostgreSQL: a schedule that fires, two pipelines at once, a cancellation, and
the automation for lost heartbeats.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, records
from tasks.storage.store_url import open_store
from tests.integration.runs import ROOT, finished, kill_when, own_cache, small_document, write_document
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

(HEARTBEATS,) = yaml.safe_load((ROOT / "examples/automations/lost-heartbeats.yaml").read_text())["automations"]
# A team's own flow, which gives a document one seed after the other until it has lived for the given seconds.
AGAIN_AND_AGAIN = """
import json, sys, time
from pathlib import Path
from prefect import flow, tags
from flows.prefect.flows import pipeline

@flow
def again_and_again(file: str, store: str, seconds: float) -> None:
    document, end_s, seed = json.loads(Path(file).read_text()), time.monotonic() + seconds, 0
    while time.monotonic() < end_s:
        seed += 1
        document["worldGeneration"]["seed"] = seed
        pipeline(document, store=store, base=str(Path(file).parent))

with tags(sys.argv[4]):
    again_and_again(sys.argv[1], sys.argv[2], float(sys.argv[3]))
"""


@dataclass(frozen=True)
class Served:
    """A Prefect server on PostgreSQL.

    Attributes:
        api_url: Of the server.
        log: What the server writes.
    """

    api_url: str
    log: Path


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
def served(tmp_path_factory: pytest.TempPathFactory) -> Generator[Served]:
    """A PostgreSQL, and a server on it whose password this process knows."""
    folder = tmp_path_factory.mktemp("served")
    with running_postgres() as port:
        api_url = "http://127.0.0.1:4244/api"
        server = environment(
            "server",
            PREFECT_SERVER_API_PORT="4244",
            PREFECT_API_DATABASE_CONNECTION_URL=f"postgresql+asyncpg://prefect@127.0.0.1:{port}/prefect",
            PREFECT_HOME=str(folder / "server"),
        )
        with (
            pytest.MonkeyPatch.context() as patch,
            started("simyard-server", server, folder / "server.log") as process,
        ):
            patch.setenv("PREFECT_API_AUTH_STRING", server["PREFECT_SERVER_API_AUTH_STRING"])
            wait_until_healthy(api_url, process, folder / "server.log")
            yield Served(api_url, folder / "server.log")


@pytest.fixture(scope="module")
def operated(served: Served, tmp_path_factory: pytest.TempPathFactory) -> Generator[Operated]:
    """Everything in prefect.yaml deployed on that server, and a worker."""
    folder = tmp_path_factory.mktemp("operated")
    worker = environment(
        "worker",
        PREFECT_API_URL=served.api_url,
        PREFECT_HOME=str(folder / "worker"),
        SIMYARD_STORE=(folder / "store").as_uri(),
        SIMYARD_BUCKETS=(folder / "buckets").as_uri(),
        SIMYARD_CACHE=own_cache(folder / "cache"),
        SIMYARD_KEYS="",
    )
    del worker["PREFECT_DEFAULT_RESULT_STORAGE_BLOCK"]  # there is no bucket here
    for _, *command in commands("docs/operate/operations.md", "deployments"):
        prefect(worker, *command)
    with started("simyard-worker", worker, folder / "worker.log"):
        yield Operated(served.api_url, open_store(worker["SIMYARD_STORE"]))


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
        run = until(lambda: _scheduled(operated.api_url, deployment["id"]))
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

    running = until(going)
    done = finished("cancel", running.arn, "--store", operated.store.url)

    assert done.returncode == 0, done.stderr
    assert ended_run(operated.api_url, run)["state_type"] == "CANCELLED"
    (closed,) = [job for job in records(operated.store, "simulation-job-batch") if job.id == running.id]
    assert closed.status == "Canceled"


def test_lost_heartbeats_crash_a_killed_run_with_its_stages_and_no_run_that_lives(served: Served, tmp_path: Path):
    message, logged = HEARTBEATS["actions"][0]["message"], served.log.stat().st_size
    with _lost_heartbeats(served.api_url):
        victim = _again_and_again(served, tmp_path / "killed", seconds=1.0)
        kill_when(victim, lambda: any(tmp_path.glob("killed/store/chunks/*/000001.started.json")))
        assert _states(served, "killed").count("Running") == 3  # its own flow, the pipeline, the batch
        live = _again_and_again(served, tmp_path / "lives", seconds=2.0 * HEARTBEATS["trigger"]["within"])
        try:
            until(lambda: "Running" not in _states(served, "killed"))
            live.wait()
        finally:
            live.kill()

    crashed = [state for states in _histories(served, "killed") for state in states if state["type"] == "CRASHED"]
    assert [state["message"] for state in crashed] == [message] * 3
    assert live.returncode == 0, (tmp_path / "lives/log").read_text()
    # Crashed, then Completed, is accepted: so each state that a run was ever in.
    lived = _histories(served, "lives")
    assert {state["name"] for states in lived for state in states} <= {"Pending", "Running", "Completed"}
    assert {states[-1]["name"] for states in lived} == {"Completed"}
    assert re.findall(r"^.*(?:ERROR|Traceback|is locked).*$", _logged_since(served, logged), re.MULTILINE) == []


@contextmanager
def _lost_heartbeats(api_url: str) -> Generator[None]:
    """The automation, as the document has it made. Runs of the other tests send a heartbeat in 180 s only."""
    variables = {"PREFECT_API_URL": api_url}
    for _, *command in commands("docs/operate/operations.md", "automation"):
        prefect(variables, *command)
    try:
        yield
    finally:
        prefect(variables, "--no-prompt", "automation", "delete", HEARTBEATS["name"])


def _again_and_again(served: Served, folder: Path, seconds: float) -> "subprocess.Popen[str]":
    """Returns the program above, started in a folder whose name is the tag of all its flow runs."""
    folder.mkdir()
    document = small_document(name=folder.name, deployment=None, gate={"successRate": {"atLeast": 0.01}})
    batch = _section(document, "simulationBatch")
    document["simulationBatch"] = {**batch, "matrix": {"seeds": 1000}, "recordings": {"episodes": "none"}}
    file, store = write_document(folder, document), (folder / "store").as_uri()
    variables = {
        "PREFECT_API_URL": served.api_url,
        "PREFECT_FLOWS_HEARTBEAT_FREQUENCY": "30",
        "PREFECT_HOME": str(folder / "prefect"),
    }
    with (folder / "log").open("w") as log:  # a pipe that nobody reads yet would stop the program
        return subprocess.Popen(
            [sys.executable, "-c", AGAIN_AND_AGAIN, str(file), store, str(seconds), folder.name],
            cwd=ROOT,
            env={**os.environ, **variables},
            stdout=log,
            stderr=log,
            text=True,
        )


def _flow_runs(served: Served, tag: str) -> list[dict[str, Any]]:
    return asked(served.api_url, "/flow_runs/filter", {"flow_runs": {"tags": {"all_": [tag]}}, "limit": 200})


def _states(served: Served, tag: str) -> list[str]:
    """Returns the names of the states that the flow runs of a tag are in."""
    return [run["state"]["name"] for run in _flow_runs(served, tag)]


def _histories(served: Served, tag: str) -> list[list[dict[str, Any]]]:
    """Returns every state that the flow runs of a tag were in, oldest first, run by run."""
    found = [asked(served.api_url, f"/flow_run_states/?flow_run_id={run['id']}") for run in _flow_runs(served, tag)]
    return [sorted(states, key=lambda state: state["timestamp"]) for states in found]


def _logged_since(served: Served, offset: int) -> str:
    return served.log.read_bytes()[offset:].decode()


def _section(document: dict[str, Any], name: str) -> dict[str, Any]:
    return document[name]


def _run_of(store: Store, name: str) -> JobRecord:
    found = [run for run in records(store, "pipeline-run") if name in json.dumps(run.model_dump(mode="json"))]
    return found[0]


def _scheduled(api_url: str, deployment: str) -> dict[str, Any] | None:
    wanted = {"deployment_id": {"any_": [deployment]}, "state": {"type": {"any_": [*ENDED]}}}
    found = asked(api_url, "/flow_runs/filter", {"flow_runs": wanted})
    return next((run for run in found if run["auto_scheduled"]), None)
