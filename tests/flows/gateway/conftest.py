"""A gateway without HTTP, answering from a new store."""

import pytest

from tasks.storage.base.store import Store
from tests.flows.gateway.asked import Asked, with_applications


@pytest.fixture
def asked(file_store: Store) -> Asked:
    """A gateway over a store with the two applications that Simyard brings along."""
    return with_applications(file_store)


@pytest.fixture
def gateway(file_store: Store) -> Asked:
    """A gateway on a folder."""
    return Asked(file_store)
