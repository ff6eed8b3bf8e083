"""A gateway without HTTP, answering from a new store."""

import pytest

from tasks.applications.registry import publish_bundle
from tasks.storage.base.store import Store
from tests.flows.gateway.asked import Asked
from tests.repository import ROOT


@pytest.fixture
def asked(file_store: Store) -> Asked:
    """A gateway over a store with the two applications that Simyard brings along."""
    made = Asked(file_store)
    made.publish()
    publish_bundle(file_store, "simulation-application", "delivery", ROOT / "applications/delivery")
    return made


@pytest.fixture
def gateway(file_store: Store) -> Asked:
    """A gateway on a folder."""
    return Asked(file_store)
