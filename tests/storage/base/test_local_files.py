"""Disks without room: told as what they are, with place and free space; nothing is left of what did not fit."""

import errno
import io
import os
import tarfile
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from specs.errors import StoreAccessDenied, StoreFull
from tasks.storage.archives import digest_of, install
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.local_files import full_disk_message, room_in
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.servers.small_disk import set_size, set_writable, small_disk

BIG = os.urandom(1 << 20)


@pytest.fixture
def disk(tmp_path: Path) -> Generator[Path]:
    """A disk of half a megabyte."""
    with small_disk(tmp_path / "disk", 512) as folder:
        yield folder


def left(folder: Path) -> list[str]:
    """Returns the files below a folder, locks left out."""
    return sorted(
        str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file() and path.parent.name != ".locks"
    )


def archive(folder: Path) -> Path:
    with tarfile.open(folder / "bundle.tar", "w", format=tarfile.USTAR_FORMAT) as tar:
        member = tarfile.TarInfo("robot/model.bin")
        member.size = len(BIG)
        tar.addfile(member, io.BytesIO(BIG))
    return folder / "bundle.tar"


@pytest.mark.parametrize(
    "write",
    [
        lambda store, _: store.put("a/big", BIG),
        lambda store, _: store.create("a/big", BIG),
        lambda store, source: store.upload("a/big", source),
        lambda store, _: store.replace("a/small", BIG, store.get("a/small").etag),
    ],
)
def test_a_full_store_says_where_and_how_much_is_left_and_holds_no_half_object(
    write: Callable[[Store, Path], object], disk: Path, tmp_path: Path
) -> None:
    store = open_store(disk.as_uri())
    store.put("a/small", b"1")
    before = left(disk)
    (tmp_path / "big").write_bytes(BIG)
    with pytest.raises(
        StoreFull, match=rf"a/(big|small): No space left on device: {disk} has 0\.\d MiB free of 0\.5 MiB"
    ):
        write(store, tmp_path / "big")
    assert left(disk) == before
    assert store.get("a/small").body == b"1"
    set_size(disk, 8 << 10)
    write(store, tmp_path / "big")


def test_a_read_only_store_is_denied(disk: Path) -> None:
    store = open_store(disk.as_uri())
    store.put("a", b"1")
    set_writable(disk, writable=False)
    with pytest.raises(StoreAccessDenied, match="a: Read-only file system; make the folder writable"):
        store.put("a", b"2")
    assert store.get("a").body == b"1"
    set_writable(disk, writable=True)
    store.put("a", b"2")


def test_a_download_onto_a_full_disk_names_that_disk_and_leaves_nothing(store: Store, disk: Path) -> None:
    store.put("big", BIG)
    with pytest.raises(StoreFull, match=rf"^No space left on device: {disk} has"):
        store.download("big", disk / "copy")
    assert left(disk) == []


def test_a_bundle_that_does_not_fit_is_not_refused_and_leaves_nothing(disk: Path, tmp_path: Path) -> None:
    packed = archive(tmp_path)
    with pytest.raises(StoreFull, match=f"{disk} has"):
        install(packed, digest_of(packed), disk / "bundle")
    assert list(disk.iterdir()) == []
    set_size(disk, 8 << 10)
    install(packed, digest_of(packed), disk / "bundle")
    assert (disk / "bundle/robot/model.bin").read_bytes() == BIG


def test_a_quota_is_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fsync(descriptor: int) -> None:
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(StoreFull, match=f"a: Disk quota exceeded: {tmp_path}"):
        LocalStore(tmp_path).put("a", b"1")


def test_a_read_only_disk_of_this_machine_is_told(disk: Path) -> None:
    set_writable(disk, writable=False)
    with pytest.raises(StoreAccessDenied, match=f"Read-only file system: {disk}"), room_in(disk):
        (disk / "file").write_bytes(b"1")


def test_what_is_no_matter_of_room_passes(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), room_in(tmp_path):
        (tmp_path / "none").read_bytes()


def test_room_is_told_of_the_disk_that_a_folder_will_be_on(tmp_path: Path) -> None:
    told = full_disk_message(OSError(errno.ENOSPC, "No space left on device"), tmp_path / "not/there")
    assert told.startswith(f"No space left on device: {tmp_path / 'not/there'} has ")
