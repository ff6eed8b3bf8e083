"""Anybody answers in the place of a robot's store: its agent stays up, and what it runs as well, also after a start."""

import subprocess
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.robot.processes import end_all
from tasks.deploy.rollout.controller import ask_robot
from tasks.storage.base.store import Store
from tests.attacks.conftest import attacked_environment, attacked_python
from tests.deploy.one_robot import NAME, desired
from tests.deploy.yard import STAYS_UP, Yard, programs_of, wait_for_report
from tests.servers.eventually import eventually
from tests.servers.odd_server import ENDLESS, ODD, OddServer, odd_server

pytestmark = pytest.mark.integration
_LOOKS = 3
_RUNS = "sleep 100000"  # longer than the longest test
_ENDING = [answer for answer in ODD if answer not in ENDLESS]
_TAKEN_FOR_AN_ANSWER = [answer for answer in _ENDING if answer[0] in "23"]
_CREDENTIALS = {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_REGION": "us-east-1"}


@pytest.fixture
def root(file_store: Store, tmp_path: Path) -> Iterator[Path]:
    """The folder of a robot that runs an application, and whose agent has ended."""
    yard = Yard(file_store, tmp_path)
    create_fleet(file_store, "couriers")
    ask_robot(file_store, desired(yard.publish({"run.sh": STAYS_UP.replace("sleep 1000", _RUNS)}), 1))
    with _agent(yard.root(NAME), file_store.url, ""):
        wait_for_report(yard, NAME, lambda reported: reported.status == "InSync")
    yield yard.root(NAME)
    end_all(yard.root(NAME))


@contextmanager
def _agent(root: Path, store: str, endpoint: str) -> Generator[subprocess.Popen[bytes]]:
    root.mkdir(parents=True, exist_ok=True)
    given = [f"--robot={NAME}", f"--root={root}", f"--store={store}", "--unsigned", "--user=0", "--grace-s=0.2"]
    with (root / "agent.log").open("ab") as log:
        agent = subprocess.Popen(
            [attacked_python(), "-m", "tasks.deploy.robot.agent", *given, "--poll-s=0.05", "--longest-poll-s=0.1"],
            cwd=root,
            env={**attacked_environment(), **_CREDENTIALS, "AWS_ENDPOINT_URL": endpoint},
            stdout=log,
            stderr=log,
        )
    try:
        yield agent
    finally:
        agent.terminate()
        agent.wait()


def _look(server: OddServer, agent: subprocess.Popen[bytes], answer: str) -> int | None:
    """Returns how the agent has ended, if it has, after some looks at a store that answers so."""
    server.answer, before = answer, server.answered[answer]
    looks = 1 if answer in ENDLESS else _LOOKS  # half a minute each
    eventually(lambda: agent.poll() is not None or server.answered[answer] - before >= looks)
    return agent.poll()


@pytest.mark.parametrize(
    "duration_s", [0.0, pytest.param(3600.0, marks=[pytest.mark.soak, pytest.mark.timeout(36000)])]
)
def test_no_answer_of_the_store_ends_an_agent_or_its_application(root: Path, duration_s: float) -> None:
    until_s = time.monotonic() + duration_s
    with odd_server("500, a page") as server, _agent(root, "s3://bucket/store", server.endpoint) as agent:
        eventually(lambda: programs_of(root) == [_RUNS])
        launches = (root / "launches").read_text()
        while True:
            ended = {answer: _look(server, agent, answer) for answer in (ODD if duration_s else _ENDING)}
            assert [answer for answer, code in ended.items() if code is not None][:1] == []
            if time.monotonic() > until_s:
                break
        assert programs_of(root) == [_RUNS]
        assert (root / "launches").read_text() == launches  # the same one


def test_no_answer_of_the_store_ends_an_agent_at_its_start(root: Path) -> None:
    ended = dict[str, int | None]()
    with odd_server() as server:
        for answer in _TAKEN_FOR_AN_ANSWER:
            server.answer = answer
            with _agent(root, "s3://bucket/store", server.endpoint) as agent:
                ended[answer] = _look(server, agent, answer)
                eventually(lambda: agent.poll() is not None or programs_of(root) == [_RUNS])
    assert {answer: code for answer, code in ended.items() if code is not None} == {}
