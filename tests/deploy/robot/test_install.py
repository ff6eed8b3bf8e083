"""Downloads that are cut, spoilt, too big, or find no room; on a folder and on a real S3 server."""

import hashlib
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from specs.errors import ObjectNotFound, ObjectTooBig, StoreDamaged, StoreFull, StoreUnreachable
from tasks.deploy.robot.install import download
from tasks.storage.base.store import Store
from tasks.storage.store_url import connect
from tests.servers.faulty_proxy import FaultyProxy, faulty_proxy
from tests.servers.seaweed import Seaweed

BODY = os.urandom(1 << 16) * 48  # 3 MiB
DIGEST = hashlib.sha256(BODY).hexdigest()
KEY = "bundles/bundle"


class CuttingStore:
    """A store whose answers are cut after so many bytes, and that counts what it gives."""

    def __init__(self, store: Store, cut_bytes: int, *, extra: bytes = b"") -> None:
        self.url = store.url
        self.given = 0
        self._store = store
        self._left = cut_bytes
        self._extra = extra

    def size(self, key: str) -> int:
        return self._store.size(key)

    def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
        for block in self._store.blocks(key, first_byte):
            if self._left < len(block):
                yield block[: self._left]
                self.given += self._left
                self._left = 1 << 40
                raise StoreUnreachable("cut")
            self._left -= len(block)
            self.given += len(block)
            yield block
        while self._extra:
            self.given += len(self._extra)
            yield self._extra


def _cutting(store: Store, cut_bytes: int = 1 << 40, *, extra: bytes = b"") -> CuttingStore:
    store.put(KEY, BODY)
    return CuttingStore(store, cut_bytes, extra=extra)


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "downloads" / "bundle.part"


def _download(store: object, target: Path, **options: int) -> None:
    download(store, KEY, target, DIGEST, **options)  # pyright: ignore[reportArgumentType] - fakes have what is asked for


@pytest.mark.parametrize("cut_bytes", [0, 1, 1_000_000, len(BODY) - 1])
def test_a_download_that_was_cut_goes_on_from_the_bytes_that_arrived(
    cut_bytes: int, store: Store, target: Path
) -> None:
    cutting = _cutting(store, cut_bytes)
    with pytest.raises(StoreUnreachable):
        _download(cutting, target)
    assert (target.stat().st_size if target.exists() else 0) == cut_bytes

    _download(cutting, target)

    assert target.read_bytes() == BODY
    assert cutting.given == len(BODY), "bytes were fetched twice"


def test_a_server_that_goes_away_in_the_middle_costs_no_byte_twice(
    s3_store: Store, seaweed: Seaweed, target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    s3_store.put(KEY, BODY)
    with _proxied(s3_store, seaweed, monkeypatch) as (behind, proxy):
        proxy.cut_answers_after(1_200_000)
        with pytest.raises(StoreUnreachable):
            _download(behind, target)
    arrived = target.stat().st_size
    heard: list[int] = []

    download(s3_store, KEY, target, DIGEST, on_block=lambda done, _size: heard.append(done))

    assert arrived > 500_000
    assert heard[0] > arrived
    assert target.read_bytes() == BODY


@pytest.mark.parametrize("spoilt", [b"\0" * 70_000, b"x" * (len(BODY) + 1), b"x" * len(BODY)])
def test_a_spoilt_beginning_is_thrown_away_and_fetched_anew(spoilt: bytes, store: Store, target: Path) -> None:
    store.put(KEY, BODY)
    target.parent.mkdir()
    target.write_bytes(spoilt)

    _download(store, target)

    assert target.read_bytes() == BODY


def test_what_is_there_already_is_not_fetched_again(file_store: Store, target: Path) -> None:
    cutting = _cutting(file_store)
    _download(cutting, target)
    _download(cutting, target)

    assert cutting.given == len(BODY)


def test_other_bytes_than_those_of_the_digest_are_refused_and_not_kept(store: Store, target: Path) -> None:
    store.put(KEY, BODY[:-1] + b"x")

    with pytest.raises(StoreDamaged, match=DIGEST):
        _download(store, target)
    assert not target.exists()


def test_more_bytes_than_were_signed_are_refused_before_any_is_written(store: Store, target: Path) -> None:
    cutting = _cutting(store)

    with pytest.raises(ObjectTooBig, match=str(len(BODY) - 1)):
        _download(cutting, target, most_bytes=len(BODY) - 1)

    assert (cutting.given, target.exists()) == (0, False)


def test_a_store_that_never_stops_sending_is_stopped(file_store: Store, target: Path) -> None:
    endless = _cutting(file_store, extra=b"x" * 100_000)

    with pytest.raises(ObjectTooBig, match="goes on"):
        _download(endless, target)

    assert endless.given <= len(BODY) + 100_000
    assert not target.exists()


def test_a_store_that_stops_too_early_is_asked_for_the_rest(file_store: Store, target: Path) -> None:
    cutting = _cutting(file_store)

    class Short(CuttingStore):
        def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
            yield next(super().blocks(key, first_byte))

    with pytest.raises(StoreUnreachable, match=f"of {len(BODY)} bytes"):
        _download(Short(file_store, 1 << 40), target)
    _download(cutting, target)
    assert target.read_bytes() == BODY


def test_a_disk_that_is_full_is_told_and_what_arrived_gives_its_room_back(file_store: Store, target: Path) -> None:
    file_store.put(KEY, BODY)
    target.parent.mkdir()
    target.symlink_to("/dev/full")

    with pytest.raises(StoreFull, match="No space left"):
        _download(file_store, target)

    assert not target.is_symlink()


def test_a_bundle_that_cannot_fit_is_refused_before_the_disk_is_filled(
    file_store: Store, target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cutting = _cutting(file_store)
    monkeypatch.setattr("shutil.disk_usage", _nearly_full)

    with pytest.raises(StoreFull, match="6 MiB are needed, 5 MiB are free"):
        _download(cutting, target)

    assert (cutting.given, target.exists()) == (0, False)


def test_a_bundle_that_is_not_there_is_missing(store: Store, target: Path) -> None:
    with pytest.raises(ObjectNotFound):
        _download(store, target)
    assert not target.exists()


class _Usage:
    free = (6 << 20) - 1


def _nearly_full(_path: Path) -> _Usage:
    return _Usage()


@contextmanager
def _proxied(store: Store, seaweed: Seaweed, patch: pytest.MonkeyPatch) -> Generator[tuple[Store, FaultyProxy]]:
    """Yields the store behind a faulty network, and the network."""
    with faulty_proxy(seaweed.endpoint) as proxy:
        with patch.context() as within:
            within.setenv("AWS_ENDPOINT_URL_S3", proxy.endpoint)
            behind = connect(store.url)
            behind.exists("store.json")
        yield behind, proxy
