import os
from collections.abc import Generator

import pytest
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings


@pytest.fixture
def client(prefect_server: str) -> Generator[SyncPrefectClient, None, None]:
    """Yields a client of the tests' server, which this process asks, too, from here on."""
    password = os.environ["PREFECT_API_AUTH_STRING"]
    with (
        temporary_settings({PREFECT_API_URL: prefect_server, PREFECT_API_AUTH_STRING: password}),
        get_client(sync_client=True) as client,
    ):
        yield client
