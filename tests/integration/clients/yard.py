"""What a script for RoboMaker meets here: a gateway of its own, bundles in a bucket, the agent of a robot."""

import os
import subprocess
import sys
import tarfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from tasks.gateway.service_model import write_model
from tests.factories.gateway.served import Served
from tests.repository import ROOT

ROBOT = "courier-1"


@contextmanager
def agent(store: Path, folder: Path) -> Generator[None]:
    """The agent of a robot, as its owner starts it: unsigned, for the demonstration."""
    folder.mkdir()
    command = [sys.executable, "-m", "simyard", "agent", "--robot", ROBOT, "--root", str(folder / "root"), "--unsigned"]
    if os.getuid() == 0:
        command += ["--user", "0"]  # pytest's folders let no other account in
    environment = os.environ | {"PYTHONPATH": str(ROOT), "SIMYARD_CACHE": str(folder / "cache")}
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            [*command, "--store", store.as_uri()], env=environment, cwd=folder, stdout=log, stderr=log
        )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def client_environment(gateway: Served, models: Path) -> dict[str, str]:
    """What changes for a script that knew RoboMaker: where it is, whose keys, and the model that SDKs lost."""
    write_model(models)
    own = {name: value for name, value in os.environ.items() if not name.startswith(("AWS_", "PYTHON"))}
    return own | {
        "AWS_ENDPOINT_URL_ROBOMAKER": f"http://{gateway.host}",
        "AWS_ACCESS_KEY_ID": gateway.owner.key_id,
        "AWS_SECRET_ACCESS_KEY": gateway.owner.secret,
        "AWS_DEFAULT_REGION": "us-west-2",
        "AWS_DATA_PATH": str(models),
    }


def make_buckets(store: Path) -> None:
    """Makes three buckets; in one are the bundles of two applications that come with Simyard, as a build puts them."""
    for bucket in ("builds", "worlds", "results"):
        (store / "buckets" / bucket).mkdir(parents=True)
    for name in ("courier", "delivery"):
        with tarfile.open(store / "buckets" / "builds" / f"{name}-by-api.tar", "w") as archive:
            archive.add(ROOT / "applications" / name, arcname=".", filter=_packages)


def _packages(member: tarfile.TarInfo) -> tarfile.TarInfo | None:
    return None if member.name.endswith(("README.md", "__pycache__")) else member
