"""Clients of several years make every call and turn every page of a real gateway with signatures.

The errors of each operation: tests/flows/gateway/test_documented_errors.py.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from specs.robomaker.operations import OPERATIONS
from tasks.storage.base.local_files import cache_folder
from tests.factories.gateway.served import served
from tests.integration.clients.yard import agent, client_environment, make_buckets
from tests.repository import ROOT
from tests.servers.tools import need_tool

pytestmark = [pytest.mark.integration, pytest.mark.long]
RELEASES = {"newest": ["boto3"], "of 2024": ["boto3==1.34.144"], "AWS CLI": ["awscli"]}


def drive(folder: Path, python: str = sys.executable, aws: str = "") -> dict[str, Any]:
    """Makes every call by a client, and asserts that each was made."""
    command = [python, str(ROOT / "tests/integration/clients/drive_work.py"), *([aws] if aws else [])]
    with served(folder / "gateway", workers=1) as gateway, agent(gateway.store, folder / "robot"):
        make_buckets(gateway.store)
        environment = client_environment(gateway, folder / "models")
        done = subprocess.run(command, env=environment, cwd=folder, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr[-6000:]
    work = json.loads(done.stdout.splitlines()[-1])
    assert {*work["called"]} == {*OPERATIONS}
    assert {*work["pages"]} == {name for name, operation in OPERATIONS.items() if operation.pages}
    assert all(len(pages) > 1 and set(pages) == {1} for pages in work["pages"].values()), work["pages"]
    return {"calls": len(work["called"]), "pages": work["pages"], "s": work["s"]}


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
def test_boto3_makes_every_call(tmp_path: Path):
    drive(tmp_path)


@pytest.mark.soak
@pytest.mark.usefixtures("prefect_server")
@pytest.mark.parametrize("name", RELEASES)
def test_another_client_makes_every_call(name: str, tmp_path: Path):
    programs = release(name)
    aws = str(programs / "aws") if name == "AWS CLI" else ""
    print(name, drive(tmp_path, str(programs / "python"), aws))  # noqa: T201 - the counts, for who looks with -s
