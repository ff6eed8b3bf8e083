from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.robomaker.bundle import Version
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import CarefulRobot, Owner, asked
from tests.deploy.yard import Yard


@pytest.fixture
def file_store(tmp_path: Path) -> Store:
    """A new store in the folder of the test, where it looks for keys that should not be there."""
    return open_store((tmp_path / "store").as_uri())


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
