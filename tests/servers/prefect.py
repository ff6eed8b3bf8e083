"""One Prefect server for all tests of a session, and one unbroken run on it; each starts when a test first asks."""

import os
from collections.abc import Generator
from pathlib import Path

import pytest

from tasks.server.process import run_server, wait_until_healthy
from tests.integration.runs import finished, small_document, write_document


@pytest.fixture(scope="session")
def prefect_server(tmp_path_factory: pytest.TempPathFactory) -> Generator[str, None, None]:
    """Yields the API URL of a real Prefect server, with the variables that lead to it set for this process and
    its children."""
    home = tmp_path_factory.mktemp("prefect")
    with run_server(home) as (server, process):
        wait_until_healthy(server, process)
        before = {name: os.environ.get(name) for name in ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING", "PREFECT_HOME")}
        os.environ.update(server.environment(), PREFECT_HOME=str(home))
        yield server.api_url
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@pytest.fixture(scope="session")
def small_run(prefect_server: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder with a document and, in `.simyard`, the store of its unbroken run."""
    folder = tmp_path_factory.mktemp("small")
    file = write_document(folder, small_document())
    result = finished("run", str(file), "--store", (folder / ".simyard").as_uri())
    assert result.returncode == 0, result.stdout + result.stderr
    return folder
