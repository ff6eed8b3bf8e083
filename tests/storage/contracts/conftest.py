"""What every store promises is tried on each kind of store."""

import pytest

from tasks.storage.base.store import Store


@pytest.fixture(params=["file_store", "s3_store"])
def store(request: pytest.FixtureRequest) -> Store:
    """A new store, of each kind in turn."""
    return request.getfixturevalue(request.param)
