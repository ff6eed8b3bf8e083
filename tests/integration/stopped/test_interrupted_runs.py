"""A run that is interrupted, or whose server goes away: it ends, says how to go on, and leaves no process."""

import os
import signal
import subprocess
from collections.abc import Generator
from pathlib import Path

import pytest

from tasks.server.process import Server, end, launch, wait_until_healthy
from tests.integration.runs import simyard, small_document, write_document
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    """A document whose simulation outlasts the test."""
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 4_000  # pyright: ignore[reportIndexIssue]
    return write_document(tmp_path, document)


@pytest.fixture
def own_server(tmp_path: Path) -> Generator[tuple[Server, "subprocess.Popen[bytes]"], None, None]:
    """A server that a test may kill."""
    server, process = launch(tmp_path / "prefect", bound=True)
    try:
        wait_until_healthy(server, process)
        yield server, process
    finally:
        end(process)


@pytest.mark.long
def test_a_run_whose_server_is_killed_ends_by_itself(
    endless: Path, tmp_path: Path, own_server: tuple[Server, "subprocess.Popen[bytes]"]
):
    chosen, server = own_server
    environment = {**chosen.environment(), "SIMYARD_SERVER_WAIT": "5"}
    run = simyard("run", str(endless), "--store", (tmp_path / "store").as_uri(), **environment)
    _in_simulation(run, tmp_path / "store")
    server.send_signal(signal.SIGKILL)
    _, err = run.communicate()
    assert run.returncode == 3, err
    goes_on = "the same command continues this run if the document is unchanged"
    assert f"the Prefect server at {chosen.api_url} went away; {goes_on}" in err
    assert "Traceback" not in err


@pytest.mark.long
def test_an_interrupted_run_ends_its_server_and_says_how_to_go_on(endless: Path, tmp_path: Path):
    environment = {"PREFECT_HOME": str(tmp_path / "prefect"), "PREFECT_API_URL": ""}
    run = simyard("run", str(endless), "--store", (tmp_path / "store").as_uri(), **environment)
    _in_simulation(run, tmp_path / "store")
    run.send_signal(signal.SIGTERM)
    _, err = run.communicate()
    assert run.returncode == 143, err
    assert err.splitlines()[-1] == "interrupted; the same command continues this run if the document is unchanged"
    (log,) = (tmp_path / "prefect").glob("server-*.log")
    assert eventually(lambda: not Path("/proc", log.stem.removeprefix("server-")).exists())


@pytest.mark.long
def test_two_runs_at_once_on_an_empty_database_both_begin(tmp_path: Path):
    document = small_document()
    worlds = {"name": "worlds", "worldGeneration": document["worldGeneration"]}
    file = write_document(tmp_path, worlds)
    home = {"PREFECT_HOME": str(tmp_path / "prefect"), "PREFECT_API_URL": ""}
    stores = [(tmp_path / name).as_uri() for name in ("one", "other")]
    runs = [simyard("run", str(file), "--store", store, **{**os.environ, **home}) for store in stores]
    ended = [(run.communicate()[1], run.returncode) for run in runs]
    assert [code for _, code in ended] == [0, 0], ended


def _in_simulation(run: "subprocess.Popen[str]", store: Path) -> None:
    eventually(lambda: any(store.glob("chunks/*/*.json")) or run.poll() is not None)
    assert run.poll() is None, run.communicate()
