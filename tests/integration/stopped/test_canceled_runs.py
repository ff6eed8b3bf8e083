"""`simyard cancel` and Prefect's cancel: the records end Canceled within seconds, and what is done stays."""

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from flows.resources.kinds import cancel_resource
from specs.errors import DocumentError
from tasks.simulate.batch.batch_jobs import describe_batch
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import is_terminal, records
from tasks.storage.store_url import open_store
from tests.integration.prefect_features.test_deployments import _prefect, _program
from tests.integration.runs import ROOT, finished, jobs, simyard, small_document, tables, write_document
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration


@pytest.mark.long
def test_a_cancelled_batch_ends_canceled_with_the_rows_of_what_was_done(prefect_server: str, tmp_path: Path):
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 300  # pyright: ignore[reportIndexIssue]
    store_url = (tmp_path / "store").as_uri()
    run = simyard("run", str(write_document(tmp_path, document)), "--store", store_url)
    assert eventually(lambda: any((tmp_path / "store").glob("chunks/*/000001.started.json")))
    store = open_store(store_url)
    (batch,) = records(store, "simulation-job-batch")
    cancel_resource(store, batch.arn.replace("simulation-job-batch", "simulation-job", 1) + "/1199")
    assert finished("cancel", batch.arn, "--store", store_url).returncode == 0
    _, err = run.communicate()
    assert (run.returncode, err.splitlines()[-1].startswith("Canceled: canceled on request")) == (3, True), err
    answer = describe_batch(store, batch.id)
    assert answer.status == "Canceled"
    assert {each.failureCode for each in answer.failedRequests or ()} == {"BatchCanceled"}
    statuses = tables(store)["results"].column("status").to_pylist()
    assert (len(statuses), statuses[:16]) == (1200, ["Completed"] * 16)
    assert statuses[-1] == "Canceled"
    with pytest.raises(DocumentError, match="this one is Canceled"):
        cancel_resource(store, batch.arn)


POOL = "cancellation"
TRACES = {
    "compilation": "chunks/*/000000.started.json",
    "simulation": "chunks/*/000001.started.json",
    "deployment": "robots/*/desired.json",
}


@pytest.fixture
def worker(prefect_server: str, tmp_path: Path) -> Generator["subprocess.Popen[bytes]", None, None]:
    """A worker with a deployment `pipeline/to-cancel`, whose flows find the store in its environment."""
    _prefect("work-pool", "create", POOL, "--type", "process", "--overwrite")
    _prefect("--no-prompt", "deploy", "flows.prefect.flows.pipeline", "--name", "to-cancel", "--pool", POOL)
    environment = {"PREFECT_WORKER_QUERY_SECONDS": "2", "SIMYARD_STORE": (tmp_path / "store").as_uri()}
    with (tmp_path / "worker.log").open("wb") as log:
        process = subprocess.Popen(
            [_program("prefect"), "worker", "start", "--pool", POOL, "--limit", "1"],
            env={**os.environ, **environment},
            cwd=ROOT,
            stdout=log,
            stderr=log,
        )
        yield process
        process.terminate()
        process.wait()


def begin(folder: Path, trace: str, **matrix: int) -> tuple[str, Store]:
    """Returns the flow run's id and the store, once the run has come to its trace."""
    document = small_document()
    document["simulationBatch"]["matrix"].update(matrix)  # pyright: ignore[reportIndexIssue]
    file = write_document(folder, document)
    parameters = json.dumps({"spec": document, "base": str(file.parent)})
    started = _prefect("deployment", "run", "pipeline/to-cancel", "--params", parameters)
    found = re.search(r"flow-run/([0-9a-f-]{36})", started.stdout) or re.search(r"[0-9a-f-]{36}", started.stdout)
    assert found, started.stdout
    assert eventually(lambda: any((folder / "store").glob(trace)))
    return found[found.lastindex or 0], open_store((folder / "store").as_uri())


def statuses(store: Store) -> dict[str, list[str]]:
    return {kind: [job.status for job in found] for kind, found in jobs(store).items() if found}


@pytest.mark.soak
@pytest.mark.parametrize("stage", TRACES)
@pytest.mark.usefixtures("worker")
def test_a_flow_run_that_prefect_cancels_leaves_its_run_and_its_job_canceled(tmp_path: Path, stage: str):
    seeds = 8 if stage == "deployment" else 4_000
    run, store = begin(tmp_path, TRACES[stage], seeds=seeds)
    _prefect("flow-run", "cancel", run)
    begun_s = time.monotonic()
    eventually(lambda: all(is_terminal(job) for found in jobs(store).values() for job in found))
    print(stage, time.monotonic() - begun_s)  # noqa: T201
    kind = "deployment-job" if stage == "deployment" else "simulation-job-batch"
    ended = statuses(store)
    assert (ended["pipeline-run"], ended[kind]) == (["Canceled"], ["Canceled"])
    assert ended["world-generation-job"] == ["Completed"]
    # Prefect's own runner says so up to a minute after its process has ended.
    assert eventually(lambda: "Cancelled" in _prefect("flow-run", "inspect", run).stdout)
    if stage != "deployment":
        rows = tables(store)["results"].column("status").to_pylist()
        assert set(rows) <= {"Completed", "Canceled"}
        assert len(rows) == 4 * 4_000


@pytest.mark.soak
def test_a_worker_that_is_told_to_end_leaves_a_run_that_simyard_continues(
    worker: "subprocess.Popen[bytes]", tmp_path: Path
):
    _, store = begin(tmp_path, TRACES["simulation"], seeds=400)
    worker.send_signal(signal.SIGTERM)
    worker.wait()
    assert statuses(store)["simulation-job-batch"] == ["InProgress"]
    assert statuses(store)["pipeline-run"] == ["Running"]
    result = finished("run", str(tmp_path / "document.yaml"), "--store", store.url)
    assert result.returncode == 0, result.stderr
    assert statuses(store)["pipeline-run"] == ["Completed"]
