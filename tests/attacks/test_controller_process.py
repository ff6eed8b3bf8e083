"""Strangers' code in a run: a controller that ends its process judges no batch, and one that hangs can be interrupted.

On commit d54b1a2 controllers ran in the process that holds keys and the exit code. One that raises, writes files or
looks for keys: tests/simulate/sandbox/test_sandbox_client.py.
"""

import signal
import time

import pytest

from tests.attacks.conftest import Owner, Writer
from tests.integration.runs import write_document
from tests.repository import ROOT

pytestmark = pytest.mark.integration
_INCONCLUSIVE, _INTERRUPTED = 4, 130
# From the beginning of a chunk to a controller's third step. Nothing tells from outside that it sleeps; before it does,
# the run can be interrupted anyway.
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


def test_a_controller_that_ends_its_process_turns_no_pipeline_green(owner: Owner, writer: Writer):
    """A controller exits with 0, so that CI sees a green run with nothing judged; it has a process of its own."""
    ended = owner.simyard("run", _document(owner, "os._exit(0)"))
    assert ended.returncode == _INCONCLUSIVE, ended.stdout
    assert "The gate says INCONCLUSIVE" in ended.stdout
    said = "exit code 0"
    assert said in ended.stdout or any(said.encode() in writer.get(key) for key in writer.keys("jobs/"))


def test_a_run_whose_controller_hangs_can_be_interrupted(owner: Owner, writer: Writer):
    """A controller sleeps for ever, so that the run can be neither ended nor cancelled; its process is killed."""
    run = owner.start("run", _document(owner, "time.sleep(10_000)"))
    while not any("/000000.started" in key for key in writer.keys("chunks/")):
        assert run.poll() is None, run.communicate()[0]
        time.sleep(0.1)
    time.sleep(_UNTIL_IT_HANGS_S)
    run.send_signal(signal.SIGINT)
    told, _ = run.communicate(timeout=250)
    assert run.returncode == _INTERRUPTED, told
    assert "the same command continues this run" in told
