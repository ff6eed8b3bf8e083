"""A store that a gc is let loose on."""

import pytest

from tasks.storage.base.store import Store
from tests.housekeeping.yard import Yard


@pytest.fixture
def yard(file_store: Store) -> Yard:
    """A store in a folder; `test_properties` has one life of a store on a real server."""
    return Yard(file_store)
