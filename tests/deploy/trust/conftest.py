from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.storage.store import Store
from tests.deploy.trust.trusting import CarefulRobot, Owner
from tests.deploy.yard import Yard


@pytest.fixture
def owner(yard: Yard, tmp_path: Path) -> Owner:
    return Owner(yard.store, tmp_path / "keys")


@pytest.fixture
def careful(yard: Yard, owner: Owner) -> Iterator[CarefulRobot]:
    robot = CarefulRobot(yard, owner.root)
    yield robot
    robot.robot.end()


@pytest.fixture
def anywhere(store: Store, tmp_path: Path) -> Owner:
    """Keys for a store of each kind in turn."""
    return Owner(store, tmp_path / "keys")
