"""`kill -9` of a run in each stage, of a worker with its run, of the server: the next one goes on, and nothing is lost.

Nothing is done twice, and nothing stays Running on Prefect's pages.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.prefect_features.test_deployments import _prefect, _program
from tests.integration.runs import (
    JOB_KINDS,
    ROOT,
    assert_same,
    finished,
    jobs,
    kill_when,
    recordings,
    simyard,
    small_document,
    tables,
    write_document,
)
from tests.integration.stopped.operated import asked
from tests.servers.eventually import eventually
from tests.servers.restarting_server import RestartingServer, restarting_server

pytestmark = pytest.mark.integration

# What a store holds while a stage is under way. The gate's window is between the batch's audit and its evidence.
_STAGES = {
    "world generation": "worlds/*/*.json",
    "world export": "jobs/world-export-job/*.json",
    "simulation": "chunks/*/000000.json",
    "audit": "results/*/audit-begun.json",
    "gate": "buckets/results/nightly/*/audit.json",
    "deployment": "robots/*/desired.json",
}


@pytest.mark.long
@pytest.mark.parametrize(
    "stages",
    [
        pytest.param(("simulation", "deployment"), id="two"),
        pytest.param(tuple(_STAGES), id="all", marks=pytest.mark.soak),
    ],
)
def test_a_run_killed_in_every_stage_ends_like_an_unbroken_one(
    stages: tuple[str, ...], tmp_path: Path, small_run: Path
):
    file = write_document(tmp_path, small_document())
    broken = tmp_path / "broken"
    command = ("run", "--direct", str(file), "--store", broken.as_uri())
    for trace in map(_STAGES.__getitem__, stages):
        kill_when(simyard(*command), lambda trace=trace: any(broken.glob(trace)))
    result = finished(*command)
    assert result.returncode == 0, result.stderr
    ours, theirs = open_store(broken.as_uri()), open_store((small_run / ".simyard").as_uri())
    assert {kind: len(found) for kind, found in jobs(ours).items()} == dict.fromkeys(JOB_KINDS, 1)
    assert tables(ours)["results"].num_rows == 32
    assert_same(ours, theirs)
    assert list(recordings(ours)) == ["/000000.parquet", "/000001.parquet"]


@pytest.mark.long
def test_all_changed_files_are_named_by_the_run_that_goes_on(tmp_path: Path):
    gate = {"successRate": {"atLeast": 0.5}, "collisionRate": {"atMost": 0.6}, "stopEarly": True}
    file = write_document(tmp_path, small_document(gate=gate))
    store = tmp_path / "store"
    command = ("run", "--direct", str(file), "--store", store.as_uri())
    kill_when(simyard(*command), lambda: any(store.glob("results/*/evidence.json")))
    world = sorted(store.glob("worlds/*/world-*.json"))[0]
    world.write_bytes(world.read_bytes().replace(b"0", b"1", 1))
    (failures,) = store.glob("buckets/*/**/failures.parquet")
    (audited,) = store.glob("buckets/*/**/audit.json")
    failures.write_bytes(failures.read_bytes()[:-8])  # no reader can make anything of it
    audited.write_bytes(audited.read_bytes() + b" ")
    result = finished(*command)
    assert result.returncode == 1, result.stderr
    told = " ".join(result.stdout.split())
    assert "Refused" in told
    assert f"worlds/{world.parent.name}/{world.name}, has changed" in told
    assert f"{audited.parent.name}/audit.json has changed" in told
    assert f"{failures.parent.name}/failures.parquet has changed" in told
    assert told.count("There is no new report: MismatchedEtag:") == 1
    assert not any(store.glob("robots/*/desired.json"))
    (evidence,) = store.glob("results/*/evidence.json")
    assert json.loads(evidence.read_bytes())["left_out"] == 16  # it was certain after the first of two chunks


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
    assert eventually(reached(document.parent, stage))
    for process in [worker.pid, *descendants(worker.pid)]:
        os.kill(process, 9)
    worker.wait()
    assert_the_next_run_finishes_it_and_nothing_is_left(prefect_server, document, elsewhere)


def descendants(pid: int) -> list[int]:
    """Returns the processes that a process started, and those that they started."""
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    found = [int(each) for each in listed.stdout.split()]
    return [*found, *(below for each in found for below in descendants(each))]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[RestartingServer]:
    """A server that this test may kill; this process asks it, too."""
    with restarting_server(tmp_path / "prefect") as found:
        for name, value in found.environment().items():
            monkeypatch.setenv(name, value)
        yield found


def started(how: str, file: Path, store: Path, server: RestartingServer) -> "subprocess.Popen[str]":
    if how == "simyard run":
        return simyard("run", str(file), "--store", store.as_uri(), SIMYARD_SERVER_WAIT="240", **server.environment())
    return plain_python(file, **server.environment(), PREFECT_CLIENT_MAX_RETRIES="7")


@pytest.mark.soak
@pytest.mark.parametrize("stage", TRACES)
@pytest.mark.parametrize("how", ["simyard run", "plain Python"])
def test_a_server_that_is_started_again_costs_a_run_only_waiting(
    how: str, stage: str, server: RestartingServer, tmp_path: Path, small_run: Path
) -> None:
    store = tmp_path / "store"
    run = started(how, write_document(tmp_path, small_document()), store, server)
    eventually(lambda: any(store.glob(TRACES[stage])) or run.poll() is not None)
    assert run.poll() is None, run.communicate()
    server.kill()
    time.sleep(3.0)
    server.start_again()
    out, _ = run.communicate()
    assert run.returncode == 0, out
    assert eventually(lambda: not flow_runs(server.api_url, NOT_ENDED))
    assert_same(open_store(store.as_uri()), open_store((small_run / ".simyard").as_uri()))


@pytest.mark.soak
@pytest.mark.usefixtures("prefect_server")
def test_a_killed_run_is_told_as_left_and_reaped_and_continued(tmp_path: Path) -> None:
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 100  # pyright: ignore[reportIndexIssue]
    file, store = write_document(tmp_path, document), tmp_path / "store"
    at = ("--store", store.as_uri())
    kill_when(simyard("run", str(file), *at), lambda: any(store.glob("chunks/*/000001.started.json")))
    run = jobs(open_store(store.as_uri()))["pipeline-run"][0]
    left = "nobody works on it: simyard run of apartment-regression continues it if neither document"
    assert f"{run.arn} is Running, and {left}" in finished("list", "pipeline-runs", *at).stderr
    assert f"is InProgress, and {left}" in finished("list", "simulation-job-batches", *at).stderr
    assert left in finished("describe", run.arn, *at).stderr
    reaped = finished("reap", *at)
    assert (reaped.returncode, reaped.stdout.count("apartment-regression continues it")) == (0, 2), reaped
    result = finished("run", str(file), *at)
    assert result.returncode == 0, result.stderr
    assert "no job is under way" in finished("reap", *at).stdout


@pytest.mark.soak
@pytest.mark.usefixtures("prefect_server")
def test_a_run_whose_process_sleeps_is_left_alone_when_it_wakes_up(tmp_path: Path) -> None:
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 100  # pyright: ignore[reportIndexIssue]
    file, store = write_document(tmp_path, document), tmp_path / "store"
    at = ("--store", store.as_uri())
    run = simyard("run", str(file), *at)
    assert eventually(lambda: any(store.glob("chunks/*/000001.started.json")))
    run.send_signal(signal.SIGSTOP)
    reaped = finished("reap", *at)  # as it finds a process on another machine: by watching its claim
    run.send_signal(signal.SIGCONT)
    _, err = run.communicate()
    assert (run.returncode, reaped.returncode) == (0, 0), err
    assert {kind: len(found) for kind, found in jobs(open_store(store.as_uri())).items()}["pipeline-run"] == 1
