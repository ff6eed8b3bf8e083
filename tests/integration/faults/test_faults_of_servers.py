"""Prefect servers that are killed and started again in the middle of a run: it costs waiting, and nothing else."""

import os
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.runs import JOB_KINDS, jobs, simyard, small_document, tables, worlds, write_document
from tests.servers.eventually import eventually
from tests.servers.restarting_server import RestartingServer, restarting_server

pytestmark = [pytest.mark.integration, pytest.mark.soak, pytest.mark.timeout(900)]
_STAGES = {
    "world generation": "worlds/*/*.json",
    "batch": "chunks/*/*.started.json",
    "roll-out": "robots/*/desired.json",
}
_PLAIN = """
import sys, yaml
from pathlib import Path
from flows.prefect.flows import pipeline
from specs.pipeline.document import PipelineSpec
file = Path(sys.argv[1])
pipeline(PipelineSpec.model_validate(yaml.safe_load(file.read_text())), store=sys.argv[2], base=str(file.parent))
"""


@pytest.fixture
def server(tmp_path: Path) -> Generator[RestartingServer]:
    """A server that this test may kill."""
    with restarting_server(tmp_path / "prefect") as found:
        yield found


def started(how: str, file: Path, store: Path, server: RestartingServer) -> "subprocess.Popen[str]":
    if how == "simyard run":
        return simyard("run", str(file), "--store", store.as_uri(), SIMYARD_SERVER_WAIT="240", **server.environment())
    environment = {**os.environ, **server.environment(), "PREFECT_CLIENT_MAX_RETRIES": "7"}
    command = [sys.executable, "-c", _PLAIN, str(file), store.as_uri()]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("stage", _STAGES)
@pytest.mark.parametrize("how", ["simyard run", "plain Python"])
def test_a_server_that_is_started_again_costs_a_run_only_waiting(
    how: str, stage: str, server: RestartingServer, tmp_path: Path, small_run: Path
) -> None:
    store = tmp_path / "store"
    run = started(how, write_document(tmp_path, small_document()), store, server)
    eventually(lambda: any(store.glob(_STAGES[stage])) or run.poll() is not None, timeout_s=200.0)
    assert run.poll() is None, run.communicate()
    server.kill()
    time.sleep(3.0)
    server.start_again()
    out, err = run.communicate(timeout=600)
    assert run.returncode == 0, out + err
    ours, theirs = open_store(store.as_uri()), open_store((small_run / ".simyard").as_uri())
    assert {kind: len(found) for kind, found in jobs(ours).items()} == dict.fromkeys(JOB_KINDS, 1)
    assert worlds(ours) == worlds(theirs)
    assert all(tables(ours)[name].equals(table) for name, table in tables(theirs).items())
