"""Strangers' code in a run: a controller that ends the process, interrupts it, hangs or prints judges no batch.

On commit d54b1a2 controllers ran in the process that holds keys and the exit code. That an application has no file to
write, no network, and no environment of the run is in tests/simulate/sandbox/test_sandbox_client.py.
"""

import signal
import time
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner, Writer
from tests.integration.runs import write_document
from tests.repository import ROOT

pytestmark = pytest.mark.integration
_INCONCLUSIVE, _INTERRUPTED = 4, 130
# From the beginning of the batch's chunk to a controller's third step; before it, the run can be interrupted anyway.
_UNTIL_IT_HANGS_S = 10.0
_CONTROLLER = """
import os
import sys
import time

jax = False


def hurt():
    {hurt}


class Stranger:
    def __init__(self):
        self.steps = 0

    def reset(self, floor, goals_m):
        pass

    def step(self, observation):
        self.steps += 1
        if self.steps == 3:
            hurt()
        return [0.1, 0.0, 0.1]


def controller(environment):
    return Stranger()
"""


def _document(owner: Owner, hurt: str) -> str:
    """Returns a document whose robot application is a stranger's; its gate asks for nothing but an answer."""
    folder = owner.folder / "stranger"
    (folder / "stranger").mkdir(parents=True)
    (folder / "robot.xml").write_bytes((ROOT / "applications/courier/robot.xml").read_bytes())
    (folder / "stranger/drive.py").write_text(_CONTROLLER.format(hurt=hurt))
    robot = {"application": "stranger", "launchConfig": {"packageName": "stranger", "launchFile": "drive"}}
    request = {
        "maxJobDurationInSeconds": 2,
        "robotApplications": [robot],
        "simulationApplications": [
            {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
        ],
    }
    document = {
        "name": "stranger",
        "applications": [{"name": "stranger", "kind": "robot", "source": "stranger"}],
        "worldGeneration": {
            "template": "templates/two-rooms.json",
            "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
        },
        "simulationBatch": {
            "createSimulationJobRequests": [request],
            "matrix": {"worlds": "all", "seeds": 2},
            "outputLocation": {"s3Bucket": "results", "s3Prefix": "attacks"},
            "audit": {"lanes": 0},
        },
        "gate": {"successRate": {"atLeast": 0.5}},
    }
    return str(write_document(owner.folder, document))


@pytest.mark.parametrize(("hurt", "said"), [("sys.exit(0)", "SystemExit"), ("os._exit(0)", "exit code 0")])
def test_a_controller_that_ends_its_process_turns_no_pipeline_green(owner: Owner, writer: Writer, hurt: str, said: str):
    """A controller exits with 0, so that CI sees a green run with nothing judged; it has a process of its own."""
    ended = owner.simyard("run", _document(owner, hurt))
    assert ended.returncode == _INCONCLUSIVE, ended.stdout
    assert "The gate says INCONCLUSIVE" in ended.stdout
    assert said in ended.stdout or any(said.encode() in writer.get(key) for key in writer.keys("jobs/"))


def test_a_run_whose_controller_hangs_can_be_interrupted(owner: Owner, writer: Writer):
    """A controller sleeps for ever, so that the run can be neither ended nor cancelled; its process is killed."""
    run = owner.start("run", _document(owner, "time.sleep(1000)"))
    while not any("/000000.started" in key for key in writer.keys("chunks/")):
        assert run.poll() is None, run.communicate()[0]
        time.sleep(0.1)
    time.sleep(_UNTIL_IT_HANGS_S)
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=200)
    assert run.returncode == _INTERRUPTED, out


def test_what_a_controller_finds_in_its_environment_are_no_keys(owner: Owner):
    """A controller writes the run's environment where its author can read it; it has one without keys."""
    stolen = Path(owner.folder / "stolen")
    hurt = f"open({str(stolen)!r}, 'w').write(repr(dict(os.environ)))"
    keys = {"SIMYARD_KEYS": str(owner.folder / "keys"), "AWS_SESSION_TOKEN": "secret"}
    owner.simyard("run", _document(owner, hurt), **keys)
    assert not stolen.exists() or not (keys.keys() & eval(stolen.read_text()).keys())  # noqa: S307
