"""A searched document whose process is killed, and that is run again: the same bytes as if nobody had."""

from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.runs import finished, kill_when, simyard
from tests.integration.searched_document import searched, searched_document

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1500)]


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return searched_document(tmp_path_factory.mktemp("document"))


@pytest.fixture(scope="module")
def whole(document: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What a run leaves that nobody kills."""
    store = open_store(tmp_path_factory.mktemp("whole").as_uri())
    ended = finished("run", str(document), "--direct", "--store", store.url)
    assert ended.returncode == 0, ended.stderr
    return searched(store)


@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])
def test_it_goes_on_to_the_same_bytes(document: Path, whole: dict[str, bytes], tmp_path: Path, share: float):
    store = open_store((tmp_path / "store").as_uri())
    steps = 1 + int(share * sum(key.startswith("searches/") for key in whole))
    process = simyard("run", str(document), "--direct", "--store", store.url)
    kill_when(process, lambda: len([*store.keys("searches/")]) >= steps)
    assert searched(store).keys() < whole.keys()
    ended = finished("run", str(document), "--direct", "--store", store.url)
    assert ended.returncode == 0, ended.stderr
    assert searched(store) == whole
