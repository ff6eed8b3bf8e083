"""The promises of a fleet: in short, as part of the tests, and for long with `make soak`."""

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.robot.processes import end_all
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.promises.figures import REPORT, Figures
from tests.deploy.yard import FLEET, Yard


@pytest.fixture
def file_store(tmp_path: Path) -> Store:
    """A new store in a folder on a disk."""
    return open_store((tmp_path / "store").as_uri())


@pytest.fixture(
    params=[pytest.param("file_store", id="file"), pytest.param("s3_store", id="s3", marks=pytest.mark.soak)]
)
def yard(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Yard]:
    """A folder, and for `make soak` a bucket, with an empty fleet; what robots started is ended with the test."""
    store = request.getfixturevalue(request.param)
    create_fleet(store, FLEET)
    yield Yard(store, tmp_path)
    for root in (tmp_path / "robots").glob("*"):
        end_all(root)


@pytest.fixture
def figures(request: pytest.FixtureRequest) -> Figures:
    """Writes down what was tried, once it went well, where `make soak` wants it."""
    begun_s = time.monotonic()

    def kept(promise: int, store: str, **counts: int | float) -> None:
        if path := os.environ.get(REPORT):
            line = {"promise": promise, "store": store, "seconds": round(time.monotonic() - begun_s, 1), **counts}
            with Path(path).open("a") as file:
                file.write(json.dumps(line) + "\n")

    return kept
