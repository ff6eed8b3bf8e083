"""Stores that a gc is let loose on."""

import pytest

from tasks.storage.base.store import Store
from tests.housekeeping.yard import Yard


@pytest.fixture
def yard(store: Store) -> Yard:
    """A folder, then a bucket on a real server."""
    return Yard(store)


@pytest.fixture
def file_yard(file_store: Store) -> Yard:
    """A folder."""
    return Yard(file_store)
