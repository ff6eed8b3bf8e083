"""A gateway without HTTP, answering from a new store."""

import pytest

from tasks.storage.base.store import Store
from tests.flows.gateway.jobs.asked import Asked


@pytest.fixture
def gateway(file_store: Store) -> Asked:
    """A gateway on a folder."""
    return Asked(file_store)
