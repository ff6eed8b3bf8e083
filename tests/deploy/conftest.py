import shutil
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.robot.processes import end_all
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD, OneRobot
from tests.deploy.trust.signed_fleet import CarefulRobot, Owner, asked
from tests.deploy.yard import FLEET, Yard
from tests.factories.lively_claims import LIVELY_S, renew_often

_MEMORY, _ENOUGH_BYTES = Path("/dev/shm"), 1 << 30  # noqa: S108 - a folder of its own is made in it


@pytest.fixture
def file_store(tmp_path: Path) -> Iterator[Store]:
    """A new store in a folder; in memory where there is some, as these tests mostly waited for their disk.

    What is killed in them is processes, never the machine. The promises are tried on a disk (`tests.deploy.promises`).
    """
    if not _MEMORY.is_dir() or shutil.disk_usage(_MEMORY).free < _ENOUGH_BYTES:
        yield open_store((tmp_path / "store").as_uri())
        return
    with tempfile.TemporaryDirectory(prefix="simyard-tests-", dir=_MEMORY) as folder:
        yield open_store((Path(folder) / "store").as_uri())


@pytest.fixture
def quick_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    """Controllers in this process renew their claims so often that who waits for a renewal waits less."""
    renew_often(monkeypatch)
    monkeypatch.setattr("tasks.deploy.rollout.deployment_job.hold_claim", partial(hold_claim, ttl_s=LIVELY_S))


@pytest.fixture
def yard(file_store: Store, tmp_path: Path) -> Iterator[Yard]:
    """A store with an empty fleet; what robots started is ended with the test."""
    create_fleet(file_store, FLEET)
    yield Yard(file_store, tmp_path)
    for root in (tmp_path / "robots").glob("*"):
        end_all(root)


@pytest.fixture
def one(yard: Yard) -> Iterator[OneRobot]:
    robot = OneRobot(yard)
    yield robot
    robot.robot.end()


@pytest.fixture
def owner(yard: Yard, tmp_path: Path) -> Owner:
    return Owner(yard.store, tmp_path / "keys")


@pytest.fixture
def careful(yard: Yard, owner: Owner) -> Iterator[CarefulRobot]:
    robot = CarefulRobot(yard, owner.root)
    yield robot
    robot.robot.end()


@pytest.fixture
def installed(yard: Yard, owner: Owner, careful: CarefulRobot) -> Version:
    """What the robot runs before the attack."""
    version = yard.publish(GOOD)
    assert careful.look(asked(owner, version, "good")).status == "InSync"
    return version
