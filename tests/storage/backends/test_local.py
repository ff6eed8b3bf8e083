"""What is particular to a store in a folder; what it promises is in tests/storage/contracts."""

import errno
import os
import shutil
import socket
import stat
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import BinaryIO

import pytest

from specs.errors import ObjectConflict, ObjectNotFound, StoreAccessDenied, StoreError, StoreUnreachable, StoreUnsafe
from tasks.storage.backends import local
from tasks.storage.backends.local import LocalStore, body_etag, file_mark
from tasks.storage.base import local_files
from tasks.storage.base.store import Entry, Store
from tasks.storage.store_url import open_store
from tests.servers.racers import in_processes, missed_names

_NOBODY = 65534
_MEMORY = Path("/dev/shm")  # noqa: S108 - the folder in it has a random name


@pytest.fixture
def folder(tmp_path: Path) -> LocalStore:
    return LocalStore(tmp_path / "store")


def test_every_write_leaves_only_the_object_and_hidden_locks(folder: LocalStore, tmp_path: Path) -> None:
    etag = folder.create("a/1", b"1")
    folder.replace("a/1", b"2", etag)
    folder.put("a/1", b"3")
    (tmp_path / "source").write_bytes(b"4")
    folder.upload("a/1", tmp_path / "source")
    assert [path.name for path in (folder.root / "a").iterdir()] == ["1"]
    assert folder.keys("") == ["a/1"]


def test_what_a_dead_writer_left_is_never_listed(folder: LocalStore) -> None:
    folder.create("a/1", b"1")
    (folder.root / "a" / ".tmp-0123").write_bytes(b"half")
    assert folder.keys("") == ["a/1"]


def test_a_name_that_one_reading_of_a_changing_folder_leaves_out_is_listed(
    folder: LocalStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("1", "2"):
        folder.create(f"a/{name}", b"1")
    real, readings = os.scandir, list[int]()

    @contextmanager
    def first_without_the_name(path: Path) -> Generator[list[os.DirEntry[str]]]:
        readings.append(len(readings))
        with real(path) as names:
            found = list(names)
        if readings == [0]:
            folder.put("a/2", b"2")
            found = [entry for entry in found if entry.name != "2"]
        yield found

    monkeypatch.setattr("tasks.storage.backends.local.os.scandir", first_without_the_name)
    assert folder.keys("a") == ["a/1", "a/2"]
    assert len(readings) > 1


def test_a_folder_that_nobody_changes_is_read_once(folder: LocalStore, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.create("a/1", b"1")
    os.utime(folder.root / "a", (1.0, 1.0))
    real, readings = os.scandir, list[Path]()

    def noted(path: Path) -> object:
        readings.append(path.resolve())
        return real(path)

    monkeypatch.setattr("tasks.storage.backends.local.os.scandir", noted)
    assert folder.keys("a") == ["a/1"]
    assert readings == [folder.root / "a"]


@pytest.mark.skipif(not _MEMORY.is_dir(), reason="no disk in memory")
@pytest.mark.parametrize(
    "seconds", [pytest.param(1.0, marks=pytest.mark.long), pytest.param(15.0, marks=pytest.mark.soak)]
)
def test_a_listing_has_every_name_though_others_write_over_them(seconds: float) -> None:
    with TemporaryDirectory(dir=_MEMORY) as path:
        store = open_store(Path(path).as_uri())
        keys = [f"k/{number:04}" for number in range(2000)]
        for key in keys:
            store.put(key, b"0")
        racers = [(store.url, keys, writes, seconds) for writes in (False, True, True, True)]
        assert sum(in_processes(missed_names, racers)) == 0


def test_an_upload_that_is_killed_leaves_nothing_under_the_key_and_is_swept(file_store: Store, tmp_path: Path) -> None:
    source = tmp_path / "source"
    os.mkfifo(source)
    work = f"from tests.servers.racers import upload; upload({file_store.url!r}, 'big.bin', {str(source)!r})"
    child = subprocess.Popen([sys.executable, "-c", work])
    with source.open("wb") as half:
        half.write(b"x" * (4 << 20))  # more than a pipe holds, so the child has written some of it
        child.kill()
        child.wait()
    assert list((tmp_path / "store").glob(".tmp-*"))
    assert file_store.keys("") == ["store.json"]
    assert not file_store.exists("big.bin")
    file_store.sweep("other.bin")
    assert list((tmp_path / "store").glob(".tmp-*"))
    file_store.sweep("big.bin")
    assert not list((tmp_path / "store").glob(".tmp-*"))


@pytest.mark.parametrize("method", ["put", "delete", "upload"])
def test_nothing_is_written_between_a_comparison_and_its_replacement(
    folder: LocalStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    (tmp_path / "source").write_bytes(b"other")
    other = {"put": (b"other",), "delete": (), "upload": (tmp_path / "source",)}[method]
    writer = Thread(target=lambda: getattr(folder, method)("a.json", *other))
    etag = folder.create("a.json", b"1")
    real, reads = local.file_etag, list[Path]()

    def file_etag(path: Path) -> str:
        found = real(path)
        reads.append(path)
        if len(reads) == 2:  # the first only spares the writing
            writer.start()
            writer.join(0.3)  # without a lock it would be done by then
        return found

    with monkeypatch.context() as patched:
        patched.setattr(local, "file_etag", file_etag)
        folder.replace("a.json", b"2", etag)
    writer.join()
    assert not folder.exists("a.json") or folder.get("a.json").body == b"other"


@pytest.mark.parametrize("method", ["create", "put"])
def test_a_write_is_on_the_disk_before_it_is_acknowledged(
    folder: LocalStore, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder.root / ".locks").mkdir(parents=True)
    settled: list[str] = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        settled.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    getattr(folder, method)("a.json", b"1")
    assert settled == ["file", "folder"]


def test_new_folders_are_on_the_disk_before_a_write_is_acknowledged(
    folder: LocalStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    settled: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: settled.append(_path_of(descriptor)))
    folder.create("a/b/1", b"1")
    for parent in (folder.root.parent, folder.root, folder.root / "a", folder.root / "a/b"):
        assert str(parent) in settled


def test_a_disk_without_links_is_unsafe(folder: LocalStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, target: Path) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    with pytest.raises(StoreUnsafe, match="hard links"):
        folder.create("a.json", b"1")
    assert folder.keys("") == []


def test_without_proc_nothing_is_written_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_files, "_HELD", f"{tmp_path}/nowhere/")
    with pytest.raises(StoreError, match="/proc is not mounted"):
        LocalStore(tmp_path / "store").create("a", b"")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_and_leaves_nothing(folder: LocalStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def fsync(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    folder.create("a/1", b"1")
    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(StoreError, match="No space left"):
        folder.put("a/1", b"2")
    assert [path.name for path in (folder.root / "a").iterdir()] == ["1"]
    assert folder.get("a/1").body == b"1"


def test_a_root_that_is_a_file_is_unreachable(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StoreUnreachable, match="folder"):
        LocalStore(tmp_path / "file").create("a.json", b"1")


def test_a_folder_that_may_not_be_written_is_denied(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    work = (
        "import os, sys; from pathlib import Path; from tasks.storage.backends.local import LocalStore; "
        "from specs.errors import StoreAccessDenied\n"
        "store = LocalStore(Path(sys.argv[1]))\n"
        "if os.getuid() == 0: os.setuid(int(sys.argv[2]))\n"
        "try: store.put('a.json', b'1')\n"
        "except StoreAccessDenied as exc: sys.exit(str(exc))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", work, str(tmp_path / "store"), str(_NOBODY)], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert "may not" in ended.stderr
    assert "as root: ch" in ended.stderr


def test_a_read_only_disk_is_denied(folder: LocalStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def mkdir(self: Path, mode: int = 0o777, *, parents: bool = False, exist_ok: bool = False) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "mkdir", mkdir)
    with pytest.raises(StoreAccessDenied, match="Read-only"):
        folder.put("a.json", b"1")


def _path_of(descriptor: int) -> str:
    return str(Path(f"/proc/self/fd/{descriptor}").readlink())


def test_who_is_paused_with_a_lock_is_not_waited_for_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local, "_LONGEST_WAIT_S", 0.1)
    store = LocalStore(tmp_path)
    etag = store.create("a.json", b"1")
    with store._locked("a.json"):
        with pytest.raises(StoreUnreachable, match="paused"):
            store.replace("a.json", b"2", etag)
        with pytest.raises(StoreUnreachable, match="paused"):
            store.put("a.json", b"2")
        assert store.get("a.json").body == b"1"
    store.replace("a.json", b"2", etag)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["a.json"]


def _leave_pipe(path: Path) -> None:
    os.mkfifo(path)


def _leave_endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _leave_link(path: Path) -> None:
    path.with_name("outside").write_text("secret")
    path.symlink_to(path.with_name("outside"))


def _leave_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize("leave", [_leave_pipe, _leave_endless, _leave_link, _leave_socket, Path.mkdir])
def test_what_is_no_regular_file_is_no_object_and_keeps_nobody_waiting(
    leave: Callable[[Path], None], folder: LocalStore, tmp_path: Path
) -> None:
    folder.put("b", b"")
    leave(folder.root / "a")
    looks: list[Callable[[], object]] = [
        lambda: folder.get("a"),
        lambda: folder.size("a"),
        lambda: folder.etag("a"),
        lambda: list(folder.blocks("a")),
        lambda: folder.download("a", tmp_path / "copy"),
    ]

    for look in looks:
        with pytest.raises(ObjectNotFound):
            look()
    with pytest.raises(ObjectConflict):
        folder.replace("a", b"new", "etag")
    with pytest.raises(StoreError, match="is no regular file"):
        folder.create("a", b"new")


@dataclass(frozen=True)
class _Elsewhere:
    """A folder of the owner's outside the store, and two links to it that a stranger put into the store.

    Attributes:
        folder: With a file ``a.json``, a hidden one ``.tmp-a``, and a folder ``below`` with a file ``b.json``.
        files: What lay there at first.
    """

    folder: Path
    files: dict[Path, bytes]

    def is_unchanged(self) -> bool:
        return self.files == {path: path.read_bytes() for path in self.folder.rglob("*") if path.is_file()}


@pytest.fixture
def elsewhere(folder: LocalStore, tmp_path: Path) -> _Elsewhere:
    home = tmp_path / "home"
    (home / "below").mkdir(parents=True)
    for name in ("a.json", ".tmp-a", "below/b.json"):
        (home / name).write_bytes(b"a secret")
    folder.put("own/c.json", b"c")
    (folder.root / "linked").symlink_to(home)
    (folder.root / "own" / "linked").symlink_to(home)
    return _Elsewhere(home, {path: path.read_bytes() for path in home.rglob("*") if path.is_file()})


@pytest.mark.parametrize("key", ["linked/a.json", "own/linked/a.json", "linked/below/b.json"])
def test_no_link_to_a_folder_leads_out_of_the_store(
    folder: LocalStore, elsewhere: _Elsewhere, tmp_path: Path, key: str
) -> None:
    (tmp_path / "source").write_bytes(b"new")
    entry = Entry(key, 8, 0.0, file_mark((folder.root / key).stat()))
    attempts: list[Callable[[], object]] = [
        lambda: folder.get(key),
        lambda: folder.size(key),
        lambda: folder.etag(key),
        lambda: list(folder.blocks(key)),
        lambda: folder.exists(key),
        lambda: folder.mark(key),
        lambda: folder.entry(key),
        lambda: folder.download(key, tmp_path / "copy"),
        lambda: folder.keys(key.rpartition("/")[0]),
        lambda: folder.entries(key.rpartition("/")[0]),
        lambda: folder.unfinished(key.rpartition("/")[0]),
        lambda: folder.create(f"{key}.new", b"new"),
        lambda: folder.create(f"{key}/deeper/new", b"new"),
        lambda: folder.replace(key, b"new", body_etag(b"a secret")),
        lambda: folder.put(key, b"new"),
        lambda: folder.upload(key, tmp_path / "source"),
        lambda: folder.sweep(key),
        lambda: folder.delete(key),
        lambda: folder.delete_unchanged(entry),
        lambda: folder.discard(Entry("linked/.tmp-a", 8, 0.0, "")),
    ]
    for attempt in attempts:
        with pytest.raises(StoreError, match=r"linked is a link, which could lead out of the store"):
            attempt()
    assert elsewhere.is_unchanged()
    assert not (tmp_path / "copy").exists()


def test_a_listing_goes_into_no_link_and_shows_none(folder: LocalStore, elsewhere: _Elsewhere) -> None:
    (folder.root / "own" / "file.json").symlink_to(elsewhere.folder / "a.json")
    assert folder.keys("") == ["own/c.json"]
    assert [entry.key for entry in folder.entries("")] == ["own/c.json"]
    assert folder.unfinished("") == []


@pytest.mark.parametrize("key", ["own/file.json", "own/gone.json"])
def test_a_link_where_an_object_belongs_tells_nothing_about_what_it_leads_to(
    folder: LocalStore, elsewhere: _Elsewhere, key: str
) -> None:
    (folder.root / "own" / "file.json").symlink_to(elsewhere.folder / "a.json")
    (folder.root / "own" / "gone.json").symlink_to(elsewhere.folder / "gone.json")
    assert not folder.exists(key)
    with pytest.raises(ObjectNotFound):
        folder.entry(key)
    folder.put(key, b"new")
    assert folder.get(key).body == b"new"
    assert elsewhere.is_unchanged()


@pytest.mark.parametrize("name", [".locks", ".locks/0"])
def test_a_link_in_place_of_the_locks_is_not_followed(folder: LocalStore, elsewhere: _Elsewhere, name: str) -> None:
    shutil.rmtree(folder.root / ".locks")
    if name == ".locks":
        (folder.root / name).symlink_to(elsewhere.folder)
    else:
        (folder.root / ".locks").mkdir()
        for number in range(256):
            (folder.root / ".locks" / f"{number:02x}").symlink_to(elsewhere.folder / "a.json")
    with pytest.raises(StoreError, match="is a link"):
        folder.put("own/c.json", b"new")
    assert elsewhere.is_unchanged()
    assert folder.get("own/c.json").body == b"c"


@pytest.mark.parametrize("method", ["create", "put", "replace", "upload"])
def test_a_folder_that_becomes_a_link_during_a_write_leads_nowhere(
    folder: LocalStore, elsewhere: _Elsewhere, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    (tmp_path / "source").write_bytes(b"new")
    etag = folder.put("own/a.json", b"a secret")
    arguments = {"create": ("own/d.json", b"new"), "put": ("own/a.json", b"new")}
    arguments |= {"replace": ("own/a.json", b"new", etag), "upload": ("own/a.json", tmp_path / "source")}
    real = local.hidden_file

    def late(place: Path, mark: str = "") -> AbstractContextManager[tuple[BinaryIO, Path]]:
        (folder.root / "own").rename(folder.root / "aside")
        (folder.root / "own").symlink_to(elsewhere.folder)
        return real(place, mark)

    with monkeypatch.context() as patched:
        patched.setattr(local, "hidden_file", late)
        getattr(folder, method)(*arguments[method])
    assert elsewhere.is_unchanged()
    assert (folder.root / "aside" / arguments[method][0].removeprefix("own/")).read_bytes() == b"new"


def test_a_folder_that_becomes_a_link_during_a_listing_leads_nowhere(
    folder: LocalStore, elsewhere: _Elsewhere, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.scandir

    def late(path: Path) -> object:
        if path.resolve() == folder.root / "own":
            (folder.root / "own").rename(folder.root / "aside")
            (folder.root / "own").symlink_to(elsewhere.folder)
        return real(path)

    monkeypatch.setattr("tasks.storage.backends.local.os.scandir", late)
    assert [(entry.key, entry.size_bytes) for entry in folder.entries("own")] == [("own/c.json", 1)]


def test_the_folder_of_a_store_and_those_above_it_may_be_links(tmp_path: Path) -> None:
    (tmp_path / "disk" / "yard").mkdir(parents=True)
    (tmp_path / "disk" / "yard" / "store").mkdir()
    (tmp_path / "here").symlink_to(tmp_path / "disk" / "yard")
    (tmp_path / "linked").symlink_to(tmp_path / "here" / "store")
    for root in (tmp_path / "here" / "store", tmp_path / "linked"):
        store = LocalStore(root)
        store.put("a/1", b"1")
        assert store.keys("") == ["a/1"]
        assert (tmp_path / "disk" / "yard" / "store" / "a" / "1").exists()


def test_a_folder_deeper_than_any_key_is_listed_by_nobody(folder: LocalStore) -> None:
    folder.put("a/1", b"1")
    within = os.open(folder.root / "a", os.O_RDONLY)
    for _ in range(600):
        os.mkdir("deep", dir_fd=within)
        below = os.open("deep", os.O_RDONLY, dir_fd=within)
        os.close(within)
        within = below
    os.close(within)
    assert folder.keys("") == ["a/1"]
