from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.deploy.fleets import create_fleet
from tasks.deploy.processes import end_all
from tasks.storage.store import Store
from tests.deploy.one_robot import OneRobot
from tests.deploy.yard import FLEET, Yard


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
