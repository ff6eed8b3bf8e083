"""A writer of the store puts programs where robots of the owner's machine might look for their versions."""

import json
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner, Writer
from tests.deploy.yard import STAYS_UP

ROBOT = "couriers-1"


@pytest.fixture
def document(owner: Owner) -> str:
    """One that ships an application of the owner's to a robot of her machine."""
    package = owner.folder / "bundle/courier"
    package.mkdir(parents=True)
    (package / "run.sh").write_text(STAYS_UP)
    (package / "run.sh").chmod(0o755)
    launched = {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "run.sh"}}
    deployment = {"fleet": {"name": "couriers", "localAgents": 1}, "deploymentApplicationConfigs": [launched]}
    (owner.folder / "ship.yaml").write_text(json.dumps({"name": "ship", "deployment": deployment}))
    published = owner.simyard("app", "publish", "courier", "bundle")
    assert published.returncode == 0, published.stdout
    return "ship.yaml"


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    """What the attacker's program leaves when it runs."""
    return tmp_path / "owned"


def _plant(writer: Writer, trace: Path) -> None:
    """Puts a program in the place of each bundle's, of a robot that may have been made already."""
    script = f'#!/bin/sh\ntouch "{trace}"\nexec sleep 1000\n'.encode()
    for digest in (Path(key).name for key in writer.keys("bundles/")):
        writer.put(f"agents/{ROBOT}/versions/{digest}/courier/run.sh", script)


def test_a_version_that_was_planted_before_a_roll_out_does_not_run(
    owner: Owner, writer: Writer, document: str, trace: Path
) -> None:
    _plant(writer, trace)
    shipped = owner.simyard("run", document, "--direct")
    assert (shipped.returncode, trace.exists()) == (0, False), shipped.stdout


def test_a_version_that_was_planted_after_a_roll_out_does_not_run(
    owner: Owner, writer: Writer, document: str, trace: Path
) -> None:
    assert owner.simyard("run", document, "--direct").returncode == 0
    _plant(writer, trace)
    shipped = owner.simyard("run", document, "--direct")
    assert (shipped.returncode, trace.exists()) == (0, False), shipped.stdout
