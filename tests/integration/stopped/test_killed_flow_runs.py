"""`kill -9` of a run, of a worker with its run, of the server: nothing stays Running, the work is done once."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.prefect_features.test_deployments import _prefect, _program
from tests.integration.runs import (
    JOB_KINDS,
    ROOT,
    finished,
    jobs,
    kill_when,
    simyard,
    small_document,
    tables,
    write_document,
)
from tests.integration.stopped.operated import asked
from tests.servers.eventually import eventually
from tests.servers.restarting_server import restarting_server

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]
TRACES = {
    "generation": "worlds/*/*.json",
    "batch": "chunks/*/000001.started.json",
    "roll-out": "robots/*/desired.json",
}
PLAIN = """
import json, sys
from pathlib import Path
from flows.prefect.flows import pipeline
file = Path(sys.argv[1])
pipeline(json.loads(file.read_text()), store=sys.argv[2], base=str(file.parent))
"""
POOL = "killed"
NOT_ENDED = ["RUNNING", "PENDING", "CANCELLING"]


@pytest.fixture
def document(tmp_path: Path) -> Path:
    """A document with a run of some seconds, of a name that no other test's flow runs have."""
    document = small_document(name=tmp_path.name.replace("_", "-"))
    document["simulationBatch"]["matrix"]["seeds"] = 48  # pyright: ignore[reportIndexIssue]
    return write_document(tmp_path, document)


def reached(folder: Path, stage: str) -> Callable[[], bool]:
    return lambda: any((folder / "store").glob(TRACES[stage]))


def plain_python(document: Path, **environment: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", PLAIN, str(document), (document.parent / "store").as_uri()],
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def flow_runs(api_url: str, states: list[str]) -> list[str]:
    """Returns each flow run of the server that is in one of the states, with its state."""
    found = asked(api_url, "/flow_runs/filter", {"flow_runs": {"state": {"type": {"any_": states}}}, "limit": 200})
    return [f"{run['name']} {run['state']['name']}" for run in found]


@pytest.fixture
def elsewhere(prefect_server: str) -> set[str]:
    """The flow runs that tests of other stores left on the server that all share."""
    return set(flow_runs(prefect_server, NOT_ENDED))


def assert_the_next_run_finishes_it_and_nothing_is_left(api_url: str, document: Path, elsewhere: set[str]) -> None:
    store = (document.parent / "store").as_uri()
    left = set(flow_runs(api_url, ["RUNNING"]))
    assert any(document.parent.name.replace("_", "-") in each for each in left), left  # Prefect does not know
    again = finished("run", str(document), "--store", store)
    assert again.returncode == 0, again.stderr
    assert set(flow_runs(api_url, NOT_ENDED)) <= elsewhere
    assert_once(store)


def assert_once(store: str) -> None:
    found = jobs(open_store(store))
    assert {kind: len(each) for kind, each in found.items()} == dict.fromkeys(JOB_KINDS, 1)
    assert [run.status for run in found["pipeline-run"]] == ["Completed"]
    assert tables(open_store(store))["results"].num_rows == 192


@pytest.mark.parametrize(
    ("how", "stage"),
    [
        pytest.param("plain Python", "batch", marks=pytest.mark.long),
        *(
            pytest.param(how, stage, marks=pytest.mark.soak)
            for how in ("plain Python", "simyard run")
            for stage in TRACES
        ),
    ],
)
def test_a_run_that_was_killed_is_crashed_by_the_next_one(
    prefect_server: str, document: Path, elsewhere: set[str], how: str, stage: str
) -> None:
    store = (document.parent / "store").as_uri()
    run = plain_python(document) if how == "plain Python" else simyard("run", str(document), "--store", store)
    kill_when(run, reached(document.parent, stage))
    assert_the_next_run_finishes_it_and_nothing_is_left(prefect_server, document, elsewhere)


@pytest.mark.soak
def test_a_reaper_crashes_what_was_killed(prefect_server: str, document: Path, elsewhere: set[str]) -> None:
    kill_when(plain_python(document), reached(document.parent, "batch"))
    reaped = finished("reap", "--store", (document.parent / "store").as_uri())
    assert (reaped.returncode, reaped.stdout.count("its process is dead")) == (0, 1), reaped
    assert set(flow_runs(prefect_server, NOT_ENDED)) <= elsewhere


@pytest.mark.soak
@pytest.mark.parametrize("stage", TRACES)
def test_a_worker_that_was_killed_with_its_run_is_followed_by_the_next_run(
    prefect_server: str, document: Path, elsewhere: set[str], stage: str
) -> None:
    _prefect("work-pool", "create", POOL, "--type", "process", "--overwrite")
    _prefect("--no-prompt", "deploy", "flows.prefect.flows.pipeline", "--name", "to-kill", "--pool", POOL)
    environment = {"PREFECT_WORKER_QUERY_SECONDS": "2", "SIMYARD_STORE": (document.parent / "store").as_uri()}
    worker = subprocess.Popen(
        [_program("prefect"), "worker", "start", "--pool", POOL, "--limit", "1"],
        env={**os.environ, **environment},
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    parameters = json.dumps({"spec": json.loads(document.read_text()), "base": str(document.parent)})
    _prefect("deployment", "run", "pipeline/to-kill", "--params", parameters)
    assert eventually(reached(document.parent, stage), timeout_s=200.0)
    for process in [worker.pid, *descendants(worker.pid)]:
        os.kill(process, 9)
    worker.wait()
    assert_the_next_run_finishes_it_and_nothing_is_left(prefect_server, document, elsewhere)


def descendants(pid: int) -> list[int]:
    """Returns the processes that a process started, and those that they started."""
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    found = [int(each) for each in listed.stdout.split()]
    return [*found, *(below for each in found for below in descendants(each))]


@pytest.mark.soak
@pytest.mark.parametrize("stage", TRACES)
def test_a_server_that_was_killed_and_started_again_has_nothing_running_after_the_run(
    document: Path, stage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with restarting_server(document.parent / "server") as server:
        for name, value in server.environment().items():
            monkeypatch.setenv(name, value)
        run = plain_python(document, PREFECT_CLIENT_MAX_RETRIES="7")
        assert eventually(reached(document.parent, stage), timeout_s=200.0)
        server.kill()
        server.start_again()
        server.wait()
        out, _ = run.communicate(timeout=400)
        assert run.returncode == 0, out
        assert eventually(lambda: not flow_runs(server.api_url, ["RUNNING", "PENDING", "CANCELLING"]), timeout_s=120.0)
    assert_once((document.parent / "store").as_uri())
