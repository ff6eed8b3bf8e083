"""Clients of several years make every call, turn every page and get every error, of real gateways with signatures."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from specs.robomaker.operations import OPERATIONS
from tasks.storage.base.local_files import cache_folder
from tests.factories.gateway.served import served
from tests.integration.clients.yard import agent, client_environment, make_buckets
from tests.repository import ROOT
from tests.servers.tools import need_tool

pytestmark = [pytest.mark.integration, pytest.mark.long, pytest.mark.timeout(1200)]
FOLDER = ROOT / "tests/integration/clients"
OF_THE_STORE = {"Throttling", "InternalServer", "ServiceUnavailable"}
"""Errors that a store gives which does not answer as it should: tests/flows/gateway/test_documented_errors.py."""
NEVER = {
    # A list of nothing is empty, and what a filter names need not be there.
    *((name, "ResourceNotFound") for name in ("ListFleets", "ListRobots", "ListDeploymentJobs")),
    # An update makes no version, and there may be as many revisions as anybody wants.
    *((f"Update{kind}Application", "LimitExceeded") for kind in ("Robot", "Simulation")),
    # These requests have no token, so there is nothing that could come twice.
    *((f"Create{kind}Application", "IdempotentParameterMismatch") for kind in ("Robot", "Simulation")),
    *((f"Create{kind}ApplicationVersion", "IdempotentParameterMismatch") for kind in ("Robot", "Simulation")),
}
QUOTAS = (
    "GENERATION_JOBS",
    "EXPORT_JOBS",
    "BATCHES",
    "SIMULATION_JOBS",
    "DEPLOYMENTS",
    "APPLICATIONS",
    "TEMPLATES",
    "FLEETS",
    "ROBOTS",
    "FLEET_ROBOTS",
)
RELEASES = {"newest": ["boto3"], "of 2024": ["boto3==1.34.144"], "AWS CLI": ["awscli"]}


def asked(script: str, python: str, state: Path, environment: Mapping[str, str], aws: str) -> dict[str, Any]:
    """Returns what a script of this folder prints at last."""
    command = [python, str(FOLDER / script), str(state), *([aws] if aws else [])]
    done = subprocess.run(command, env=dict(environment), cwd=state.parent, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr[-6000:]
    return json.loads(done.stdout.splitlines()[-1])


def drive(folder: Path, python: str = sys.executable, aws: str = "") -> dict[str, Any]:
    """Makes every call by a client, and asserts that each was made and each error given."""
    state = folder / "made.json"
    with served(folder / "gateway", workers=1) as gateway, agent(gateway.store, folder / "robot"):
        make_buckets(gateway.store)
        environment = client_environment(gateway, folder / "models")
        work = asked("drive_work.py", python, state, environment, aws)
    with (
        served(folder / "second", beside=gateway) as free,
        served(folder / "limited", beside=gateway, settings={f"SIMYARD_MAX_{name}": "1" for name in QUOTAS}) as limited,
    ):
        environment = client_environment(free, folder / "models") | {"LIMITED": f"http://{limited.host}"}
        errors = asked("drive_refused.py", python, state, environment, aws)

    assert {*work["called"]} == {*OPERATIONS}
    assert {*work["pages"]} == {name for name, operation in OPERATIONS.items() if operation.pages}
    assert all(len(pages) > 1 and set(pages) == {1} for pages in work["pages"].values()), work["pages"]
    expected = {(name, error) for name, operation in OPERATIONS.items() for error in operation.errors}
    reachable = {pair for pair in expected if pair[1] not in OF_THE_STORE} - NEVER
    assert {(name, error) for name, given in errors.items() for error in given} == reachable
    return {"calls": len(work["called"]), "pages": work["pages"], "errors": len(reachable), "s": work["s"]}


def release(name: str) -> Path:
    """Returns the folder of the programs of a client, of an environment that is made once."""
    uv = need_tool("uv", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    place = cache_folder() / "clients" / name.replace(" ", "-")
    if not (place / "made").exists():
        subprocess.run([uv, "venv", "--quiet", "--clear", str(place)], check=True)
        python = str(place / "bin/python")
        subprocess.run([uv, "pip", "install", "--quiet", "--python", python, *RELEASES[name]], check=True)
        (place / "made").touch()
    return place / "bin"


@pytest.mark.usefixtures("prefect_server")
def test_boto3_makes_every_call_and_gets_every_error(tmp_path: Path):
    drive(tmp_path)


@pytest.mark.soak
@pytest.mark.usefixtures("prefect_server")
@pytest.mark.parametrize("name", RELEASES)
def test_another_client_makes_every_call_and_gets_every_error(name: str, tmp_path: Path):
    programs = release(name)
    aws = str(programs / "aws") if name == "AWS CLI" else ""
    print(name, drive(tmp_path, str(programs / "python"), aws))  # noqa: T201 - the counts, for who looks with -s
