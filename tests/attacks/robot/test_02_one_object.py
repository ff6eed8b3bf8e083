"""One unsigned object ends no verifying robot, stops no application, and keeps no owner from deploying.

The same with two thousand objects: ``tests/deploy/robot/test_spoiled_states.py``; with any number of forged
sequences: ``tests/deploy/rollout/test_controller.py``.
"""

import json
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tasks.deploy.robot.processes import end_all
from tests.attacks.conftest import Owner, Writer
from tests.attacks.robot.verifying_robot import STAYS_UP, VerifyingRobot, eventually, set_up, start_agent

DESIRED, REPORTED = "robots/r1/desired.json", "robots/r1/reported.json"
KEEP = Callable[[subprocess.Popen[str]], subprocess.Popen[str]]
HIGHEST, TOO_HIGH, DIGITS = "9007199254740992", "9007199254740993", "9" * 4300


@pytest.fixture
def robot(owner: Owner, stop_later: KEEP) -> Iterator[VerifyingRobot]:
    """A robot that runs what its owner deployed."""
    with tempfile.TemporaryDirectory(prefix="simyard-robot-") as folder:
        root = Path(folder)
        root.chmod(0o755)
        set_up(owner)
        made = VerifyingRobot(owner, root, stop_later(start_agent(owner, root)))
        done = made.deploy()
        assert done.returncode == 0, done.stdout
        eventually(lambda: len(made.runs) == 1)
        yield made
        made.agent.terminate()
        made.agent.communicate()
        end_all(root)


def _forged(body: bytes, number: str) -> bytes:
    return json.dumps({**json.loads(body), "sequence": "HERE"}).replace('"HERE"', number).encode()


def test_a_forged_state_ends_neither_the_agent_nor_its_application(robot: VerifyingRobot, writer: Writer) -> None:
    """The attacker writes a desired state with a number that no report can hold; it is refused, what runs, runs on."""
    signed, before = writer.get(DESIRED), robot.runs
    for body in [_forged(signed, TOO_HIGH), _forged(signed, "Infinity"), b"[" * 100_000]:
        writer.put(DESIRED, body)
        robot.looks()

        assert robot.lives
        assert robot.runs == before


@pytest.mark.parametrize(("key", "number"), [(DESIRED, DIGITS), (REPORTED, HIGHEST)], ids=["desired", "reported"])
def test_a_forged_number_keeps_no_owner_from_deploying(
    key: str, number: str, robot: VerifyingRobot, writer: Writer
) -> None:
    """The attacker uses up the sequences; the owner's next one comes from the clock and from what the owner signed."""
    before = robot.runs
    writer.put(key, _forged(writer.get(key), number))

    done = robot.deploy(f"{STAYS_UP}# newer\n")

    assert done.returncode == 0, done.stdout
    assert robot.lives
    eventually(lambda: len(robot.runs) == 1 and robot.runs != before)
