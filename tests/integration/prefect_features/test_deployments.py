"""A real server, process pool and worker: `prefect deploy --all`, a run on demand, and a cron that fires by itself."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tasks.server.health import authorization
from tasks.server.process import end, launch, wait_until_healthy
from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store
from tests.docs.test_readme import blocks
from tests.integration.runs import ROOT, tables
from tests.integration.stopped.operated import asked

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def store_url(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Returns where the worker's store is."""
    return (tmp_path_factory.mktemp("deployed") / "store").as_uri()


@pytest.fixture(scope="module")
def kept_server(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    """Returns the URL of a server as `simyard up` starts it, which Prefect's own programs find."""
    server, process = launch(tmp_path_factory.mktemp("kept"), bound=False)
    with pytest.MonkeyPatch.context() as patched:
        for name, value in server.environment().items():
            patched.setenv(name, value)
        try:
            wait_until_healthy(server, process)
            yield server.api_url
        finally:
            end(process)


@pytest.fixture(scope="module")
def worker(kept_server: str, store_url: str, tmp_path_factory: pytest.TempPathFactory) -> Generator[None, None, None]:
    """Deploys everything in prefect.yaml, and runs a worker for it."""
    create_pool, deploy, _ = _readme_commands()
    _prefect(*create_pool)
    _prefect(*deploy)
    log = tmp_path_factory.mktemp("worker") / "worker.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [_program("prefect"), "worker", "start", "--pool", "local", "--name", "w1", "--limit", "2"],
            env={**os.environ, "PREFECT_WORKER_QUERY_SECONDS": "2", "SIMYARD_STORE": store_url},
            cwd=ROOT,
            stdout=output,
            stderr=output,
        )
        yield
        process.terminate()
        process.wait()


def test_the_nightly_document_is_the_quickstart():
    deployed = yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]
    (nightly,) = [deployment for deployment in deployed if deployment["name"] == "nightly"]
    assert nightly["parameters"] == {"spec": {"document": "examples/quickstart.yaml"}}
    assert (ROOT / nightly["parameters"]["spec"]["document"]).is_file()


@pytest.mark.long
@pytest.mark.usefixtures("worker")
def test_a_deployment_runs_on_demand_and_a_cron_fires_by_itself(kept_server: str, store_url: str, tmp_path: Path):
    section = {"template": "two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 99}
    (tmp_path / "night.yaml").write_text(json.dumps({"name": "night", "worldGeneration": section}))
    shutil.copy(ROOT / "examples/templates/two-rooms.json", tmp_path)
    parameters = {"spec": {"document": "night.yaml"}, "base": str(tmp_path)}
    entrypoint = "flows.prefect.flows.world_generation"
    every_minute = ("--name", "every-minute", "--pool", "local", "--cron", "* * * * *")
    _prefect("--no-prompt", "deploy", entrypoint, *every_minute, "--params", json.dumps(parameters))
    watched = _prefect(*_readme_commands()[2])
    assert re.search(r"the gate of\s+arn:simyard:pipeline-run:\S+\s+says PASS:", watched.stdout), watched.stdout
    assert tables(open_store(store_url))["results"].num_rows == 384
    assert [job.status for job in records(open_store(store_url), "deployment-job")] == ["Succeeded"]
    assert [row["status"] for row in _robots_table(kept_server)] == ["InSync"] * 5
    run = _scheduled_run(kept_server)
    assert run["state_type"] == "COMPLETED"
    assert run["state"]["message"].startswith("1 world: arn:simyard:world-generation-job:")
    assert 99 in [job.detail["seed"] for job in records(open_store(store_url), "world-generation-job")]


@pytest.mark.usefixtures("worker")
@pytest.mark.parametrize(
    ("deployment", "strategy"), [("pipeline/nightly", "ENQUEUE"), ("reaping/every-ten-minutes", "CANCEL_NEW")]
)
def test_one_night_or_reaper_at_a_time(kept_server: str, deployment: str, strategy: str):
    deployed = asked(kept_server, f"/deployments/name/{deployment}")
    limited = (deployed["global_concurrency_limit"]["limit"], deployed["concurrency_options"]["collision_strategy"])
    assert limited == (1, strategy)


@pytest.mark.usefixtures("worker")
def test_the_server_refuses_a_document_that_is_not_one():
    spec = {"name": "broken", "worldGeneration": {"template": "t.json", "worldCount": {"floorplanCount": 0}}}
    refused = _prefect("deployment", "run", "pipeline/nightly", "--params", json.dumps({"spec": spec}), check=False)
    assert refused.returncode != 0
    assert "floorplanCount" in refused.stdout + refused.stderr


def _robots_table(api_url: str) -> list[dict[str, str]]:
    """Returns the table of robots that the deployment left in Prefect's pages."""
    request = urllib.request.Request(  # noqa: S310 - the test server's own URL
        f"{api_url}/artifacts/apartment-regression--deployment-robots/latest",
        headers=authorization(os.environ["PREFECT_API_AUTH_STRING"]),
    )
    with urllib.request.urlopen(request) as reply:  # noqa: S310 - same
        return json.loads(json.load(reply)["data"])


def _scheduled_run(api_url: str) -> dict[str, Any]:
    """Returns the first ended run that the schedule, and not a person, created."""
    body = {"flow_runs": {"state": {"type": {"any_": ["COMPLETED", "FAILED", "CRASHED"]}}}}
    headers = {"content-type": "application/json", **authorization(os.environ["PREFECT_API_AUTH_STRING"])}
    while True:
        request = urllib.request.Request(  # noqa: S310 - the test server's own URL
            f"{api_url}/flow_runs/filter", json.dumps(body).encode(), headers
        )
        with urllib.request.urlopen(request) as reply:  # noqa: S310 - same
            found = [run for run in json.load(reply) if run["auto_scheduled"]]
        if found:
            return found[0]
        time.sleep(1.0)


def _readme_commands() -> list[list[str]]:
    """Returns what the README says to type, without the program."""
    (block,) = blocks("deployments")
    return [line.split()[1:] for line in block.splitlines()]


def _program(name: str) -> str:
    return str(Path(sys.executable).with_name(name))


def _prefect(*arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    result = subprocess.run([_program("prefect"), *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert not check or result.returncode == 0, result.stdout + result.stderr
    return result
