from pathlib import Path

import pytest

from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store


@pytest.fixture
def file_store(tmp_path: Path) -> Store:
    """A new store in the folder of the test, where it looks for keys that should not be there."""
    return open_store((tmp_path / "store").as_uri())
