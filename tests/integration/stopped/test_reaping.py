"""A killed run: list and describe say that nobody works on it, the reaper ends what was being stopped."""

import signal
from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.runs import finished, jobs, kill_when, simyard, small_document, write_document
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.soak, pytest.mark.timeout(400)]


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


@pytest.mark.usefixtures("prefect_server")
def test_a_run_whose_process_sleeps_is_left_alone_when_it_wakes_up(tmp_path: Path) -> None:
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 100  # pyright: ignore[reportIndexIssue]
    file, store = write_document(tmp_path, document), tmp_path / "store"
    at = ("--store", store.as_uri())
    run = simyard("run", str(file), *at)
    assert eventually(lambda: any(store.glob("chunks/*/000001.started.json")), timeout_s=200.0)
    run.send_signal(signal.SIGSTOP)
    reaped = finished("reap", *at)  # as it finds a process on another machine: by watching its claim
    run.send_signal(signal.SIGCONT)
    _, err = run.communicate(timeout=300)
    assert (run.returncode, reaped.returncode) == (0, 0), err
    assert {kind: len(found) for kind, found in jobs(open_store(store.as_uri())).items()}["pipeline-run"] == 1
