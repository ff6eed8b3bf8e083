"""A killed run: list and describe say that nobody works on it, the reaper ends what was being stopped."""

from pathlib import Path

import pytest

from tasks.storage.opening import open_store
from tests.integration.runs import finished, jobs, kill_when, simyard, small_document, write_document

pytestmark = [pytest.mark.integration, pytest.mark.soak, pytest.mark.timeout(400)]


@pytest.mark.usefixtures("prefect_server")
def test_a_killed_run_is_told_as_left_and_reaped_and_continued(tmp_path: Path) -> None:
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 100  # pyright: ignore[reportIndexIssue]
    file, store = write_document(tmp_path, document), tmp_path / "store"
    at = ("--store", store.as_uri())
    kill_when(simyard("run", str(file), *at), lambda: any(store.glob("chunks/*/000001.started.json")))
    run = jobs(open_store(store.as_uri()))["pipeline-run"][0]
    left = "nobody works on it: simyard run of apartment-regression continues it"
    assert f"{run.arn} is Running, and {left}" in finished("list", "pipeline-runs", *at).stderr
    assert f"is InProgress, and {left}" in finished("list", "simulation-job-batches", *at).stderr
    assert left in finished("describe", run.arn, *at).stderr
    reaped = finished("reap", *at)
    assert (reaped.returncode, reaped.stdout.count("apartment-regression continues it")) == (0, 2), reaped
    result = finished("run", str(file), *at)
    assert result.returncode == 0, result.stderr
    assert "somebody works on every job" in finished("reap", *at).stdout
