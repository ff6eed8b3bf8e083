import json
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from specs.errors import DocumentError, ObjectConflict, ObjectExists, StoreError, StoreUnreachable, StoreUnsafe
from tasks.storage import store_url
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.store import UNBOUNDED, Store, StoredObject
from tasks.storage.store_url import open_existing_store, open_store, store_id


def test_the_first_to_open_a_store_leaves_only_its_record(file_store: Store) -> None:
    assert file_store.keys("") == ["store.json"]


def test_a_store_keeps_its_id(store: Store) -> None:
    assert store_id(open_store(store.url)) == store_id(store)


def test_a_store_of_a_newer_layout_is_refused(file_store: Store) -> None:
    record = json.loads(file_store.get("store.json", UNBOUNDED).body)
    file_store.put("store.json", json.dumps({**record, "layout": 2}).encode())
    with pytest.raises(StoreError, match=r"a newer Simyard has made this store: .*; upgrade this one"):
        open_store(file_store.url)


def test_stores_have_different_ids(tmp_path: Path) -> None:
    one, other = (open_store((tmp_path / name).as_uri()) for name in ("one", "other"))
    assert store_id(one) != store_id(other)


def test_all_who_open_a_new_store_at_once_agree_on_its_id(tmp_path: Path) -> None:
    together = Barrier(8)

    def open_it(_: int) -> str:
        together.wait()
        return store_id(open_store((tmp_path / "store").as_uri()))

    with ThreadPoolExecutor(8) as pool:
        assert len(set(pool.map(open_it, range(8)))) == 1


class _Forgiving(LocalStore):
    """A server that ignores the condition on creations, or on replacements."""

    ignored: type[StoreError] = ObjectExists

    def create(self, key: str, body: bytes) -> str:
        if self.ignored is ObjectExists:
            return self.put(key, body)
        return super().create(key, body)

    def replace(self, key: str, body: bytes, etag: str) -> str:
        if self.ignored is ObjectConflict:
            return self.put(key, body)
        return super().replace(key, body, etag)


@pytest.mark.parametrize(
    ("ignored", "told"), [(ObjectExists, "create an object that was there"), (ObjectConflict, "had changed")]
)
def test_a_store_that_ignores_conditions_is_refused_every_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ignored: type[StoreError], told: str
) -> None:
    unsafe = _Forgiving(tmp_path)
    unsafe.ignored = ignored
    monkeypatch.setattr(store_url, "connect", lambda _: unsafe)
    for _ in range(2):
        with pytest.raises(StoreUnsafe, match=told):
            open_store("file:///any")
    assert unsafe.keys("") == []


class _Counting(LocalStore):
    """A store that writes down what it is asked."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.asked: list[str] = []

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        self.asked.append(f"get {key}")
        return super().get(key, most_bytes)

    def create(self, key: str, body: bytes) -> str:
        self.asked.append(f"create {key}")
        return super().create(key, body)


def test_a_store_that_was_probed_costs_one_read_to_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    open_store((tmp_path / "store").as_uri())
    counting = _Counting(tmp_path / "store")
    monkeypatch.setattr(store_url, "connect", lambda _: counting)
    open_store("file:///any")
    assert counting.asked == ["get store.json"]


def test_a_record_of_something_else_is_told(file_store: Store) -> None:
    file_store.put("store.json", b'{"other": true}')
    with pytest.raises(StoreError, match=r"store\.json was not written by this version"):
        open_store(file_store.url)


@pytest.mark.parametrize("name", ["../../../home/courier", "", "0123456789ab/.."])
def test_a_stranger_does_not_choose_folders_of_this_machine_by_the_stores_id(file_store: Store, name: str) -> None:
    record = json.loads(file_store.get("store.json").body)
    file_store.put("store.json", json.dumps({**record, "id": name}).encode())
    with pytest.raises(StoreError, match=r"store\.json was not written by this version"):
        store_id(file_store)


def test_the_environment_names_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_STORE", (tmp_path / "named").as_uri())
    assert open_store().url == (tmp_path / "named").as_uri()


def test_the_default_store_lies_in_the_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_STORE", raising=False)
    monkeypatch.chdir(tmp_path)
    assert open_store().url == (tmp_path / ".simyard").as_uri()
    assert (tmp_path / ".simyard" / "store.json").is_file()


@pytest.mark.parametrize("as_written", ["file://{}/a b", "file://{}/a%20b", "file://{}/a b/"])
def test_a_folder_with_a_space_may_be_written_either_way(tmp_path: Path, as_written: str) -> None:
    assert open_store(as_written.format(tmp_path)).url == f"file://{tmp_path}/a%20b"


@pytest.mark.parametrize(
    "url",
    [
        "file://relative/path",
        "file:///a/../b",
        "http://host/store",
        "memory://store",
        "s3a://bucket",
        "simplecache::s3://bucket/store",
        "file:///a::b",
        "s3://",
        "s3:///prefix",
        "s3://Bucket/prefix",
        "s3://bucket/../other",
        "s3://bucket/a//b",
        "",
    ],
)
def test_what_is_no_store_is_a_fault_of_the_document(url: str) -> None:
    with pytest.raises(DocumentError):
        store_url.connect(url)


def test_a_plain_path_is_answered_with_its_url(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match=(tmp_path / "store").as_uri()):
        open_store(str(tmp_path / "store"))


def test_a_relative_path_is_answered_with_a_url_that_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(DocumentError) as refused:
        open_store("../store")
    hint = str(refused.value).rpartition("perhaps ")[2]
    assert open_store(hint).url == (tmp_path / "store").as_uri()


def test_opening_an_existing_store_makes_none(tmp_path: Path) -> None:
    url = (tmp_path / "store").as_uri()
    with pytest.raises(StoreUnreachable, match="no store there"):
        open_existing_store(url)
    assert not (tmp_path / "store").exists()
    made = open_store(url)
    assert store_id(open_existing_store(url)) == store_id(made)


@pytest.mark.parametrize("url", ["s3://key:canary@bucket/a", "https://key:canary@host/a", "x::s3://key:canary@b/a"])
def test_credentials_in_a_url_are_refused_and_not_repeated(url: str) -> None:
    with pytest.raises(DocumentError) as raised:
        open_store(url)
    assert "canary" not in str(raised.value)


def test_a_url_with_a_slash_at_the_end_is_the_same_store(s3_url: Callable[[], str]) -> None:
    url = s3_url()
    assert open_store(f"{url}/").url == url


def test_a_folder_is_opened_without_importing_an_s3_client(tmp_path: Path) -> None:
    work = (
        "import sys; from tasks.storage.store_url import open_store; open_store(sys.argv[1]); "
        "print({'fsspec', 's3fs', 'botocore', 'aiohttp'} & set(sys.modules))"
    )
    ended = subprocess.run([sys.executable, "-c", work, tmp_path.as_uri()], capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.stderr) == ("set()\n", "")
