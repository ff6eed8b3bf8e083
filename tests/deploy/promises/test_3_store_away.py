"""A store that is killed loses nothing that it acknowledged, and whoever works waits for it and goes on."""

import subprocess
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, read_desired, register_robot
from tasks.deploy.robot.processes import end_all
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import job_id, read
from tasks.storage.store_url import open_store
from tests.deploy.promises.figures import Figures, sizes
from tests.deploy.promises.mortal import process, roll_out, write_for_ever
from tests.deploy.yard import FLEET, STAYS_UP, Yard, kill
from tests.servers.eventually import eventually
from tests.servers.seaweed import Seaweed, running_seaweed

pytestmark = pytest.mark.integration
KIND = "deployment-job"
_ROBOTS = ("r1", "r2")
# Longer than a claim lasts without a heartbeat, now and then.
_AWAY_S = (2.0, 1.0, 20.0, 5.0, 40.0, 1.0, 10.0, 90.0)


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Seaweed]:
    """A server of its own, so that no other test misses it."""
    (tmp_path / "weed").mkdir()
    with running_seaweed(tmp_path / "weed") as server:
        server.make_bucket("promises")
        for name, value in server.environment().items():
            monkeypatch.setenv(name, value)
        yield server


@pytest.fixture
def busy(server: Seaweed, tmp_path: Path) -> Iterator[Yard]:
    """A fleet of real agents on that server."""
    yard = Yard(open_store("s3://promises/store"), tmp_path)
    create_fleet(yard.store, FLEET)
    agents: list[subprocess.Popen[bytes]] = []
    for name in _ROBOTS:
        create_robot(yard.store, name)
        register_robot(yard.store, FLEET, name)
        agents.append(yard.start_agent(name))
    yield yard
    for name, agent in zip(_ROBOTS, agents, strict=True):
        kill(agent)
        end_all(yard.root(name))


@pytest.mark.long
@sizes(short=1, long=8)
def test_a_roll_out_goes_on_after_its_store_was_killed(
    server: Seaweed, busy: Yard, size: int, figures: Figures
) -> None:
    script = "#!/bin/sh\nsleep 0.5\n"
    longest_s, acknowledged = 0.0, 0
    for number in range(size):
        version = busy.publish({"run.sh": f"{STAYS_UP}# {number}\n", "before.sh": script})
        request = busy.request(version, f"run-{number}", preLaunchFile="before.sh")
        controller = process(roll_out, busy.store.url, request.model_dump_json(), version.digest)
        with _writing(busy.store, f"records-{number}") as written:
            job = job_id(KIND, f"run-{number}")
            eventually(lambda job=job: any(_asked(busy.store, name, job) for name in _ROBOTS))
            server.kill()
            time.sleep(_AWAY_S[number])
            server.start_again()
            back_s = time.monotonic()
            controller.join()
            longest_s = max(longest_s, time.monotonic() - back_s)
        assert controller.exitcode == 0
        record = read(busy.store, KIND, job)
        assert (record.status, len(recorded_progress(record))) == ("Succeeded", len(_ROBOTS))
        assert {busy.current(name) for name in _ROBOTS} == {version.digest}
        assert all(busy.store.get(key).body == key.encode() * 100 for key in written)
        acknowledged += len(written)
    assert acknowledged > 0
    away_s = sum(_AWAY_S[:size])
    figures(
        3, "s3", stores_killed=size, away_s=away_s, acknowledged=acknowledged, lost=0, slowest_end_s=round(longest_s, 1)
    )


@sizes(short=3, long=100)
def test_what_was_acknowledged_is_there_after_its_writer_was_killed(
    file_store: Store, size: int, figures: Figures
) -> None:
    acknowledged = 0
    for number in range(size):
        with _writing(file_store, f"records-{number}") as written:
            time.sleep(0.02 + 0.003 * number)
        assert all(file_store.get(key).body == key.encode() * 100 for key in written)
        assert all(file_store.get(key).body == key.encode() * 100 for key in file_store.keys(f"records-{number}"))
        acknowledged += len(written)
    assert acknowledged > 0
    figures(3, "file", writers_killed=size, acknowledged=acknowledged, lost=0, torn=0)


@contextmanager
def _writing(store: Store, folder: str) -> Generator[list[str]]:
    """Lets a process write until the end of the block, kills it, and fills in what the store has acknowledged."""
    here, there = Pipe(duplex=False)
    writer = process(write_for_ever, store.url, folder, there)
    there.close()
    written: list[str] = []
    try:
        written.append(here.recv())  # it has begun
        yield written
    finally:
        writer.kill()
        writer.join()
        written += _received(here)


def _received(connection: Connection) -> Iterator[str]:
    while True:
        try:
            yield connection.recv()
        except EOFError:
            return


def _asked(store: Store, robot: str, job: str) -> bool:
    desired, _ = read_desired(store, robot)
    return desired is not None and desired.deployment == job
