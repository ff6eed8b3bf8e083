"""One Prefect server for all integration tests of a session."""

import os
from collections.abc import Generator

import pytest

from tasks.server.process import serving, wait_until_healthy


@pytest.fixture(scope="session")
def prefect_server(tmp_path_factory: pytest.TempPathFactory) -> Generator[str, None, None]:
    """Yields the API URL of a real Prefect server, with PREFECT_API_URL set for this process and its children."""
    home = tmp_path_factory.mktemp("prefect")
    with serving(home) as (server, process):
        wait_until_healthy(server, process)
        before = {name: os.environ.get(name) for name in ("PREFECT_API_URL", "PREFECT_HOME")}
        os.environ.update(PREFECT_API_URL=server.api_url, PREFECT_HOME=str(home))
        yield server.api_url
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
