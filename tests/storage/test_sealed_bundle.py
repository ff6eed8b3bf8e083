"""Unpacked bundles are used only while they hold what their digest says."""

import hashlib
import io
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from specs.errors import BundleRefused
from tasks.storage.sealed_bundle import (
    changed_bundle,
    discard_bundle,
    is_shipped,
    seal_bundle,
    sealed_files,
    stored_archive,
)
from tests.repository import ROOT

FILES = {"robot.xml": b"<mujoco/>", "package/drive.py": b"def controller(environment): ...\n", "package/run.sh": b"#!"}


def archive(folder: Path, files: dict[str, bytes] = FILES) -> tuple[Path, str]:
    path = folder / "bundle.tar"
    with tarfile.open(path, "w") as tar:
        for name, body in files.items():
            header = tarfile.TarInfo(name)
            header.size, header.mode = len(body), 0o755 if name.endswith(".sh") else 0o644
            tar.addfile(header, io.BytesIO(body))
    return path, hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def sealed(tmp_path: Path) -> tuple[Path, str]:
    path, digest = archive(tmp_path)
    (tmp_path / "cache").mkdir()
    seal_bundle(path, tmp_path / "cache" / digest, digest)
    return tmp_path / "cache" / digest, digest


def open_to_writing(files: Path) -> None:
    for path in (files, *files.rglob("*")):
        path.chmod(0o755)


def test_files_are_what_the_archive_holds_and_can_only_be_read(sealed: tuple[Path, str]) -> None:
    entry, digest = sealed

    files = sealed_files(entry, digest)

    assert files is not None
    assert {str(path.relative_to(files)): path.read_bytes() for path in files.rglob("*") if path.is_file()} == FILES
    assert {oct(path.stat().st_mode & 0o222) for path in (files, *files.rglob("*"))} == {"0o0"}
    assert (files / "package/run.sh").stat().st_mode & 0o111


def _rewrite(files: Path) -> None:
    (files / "package/drive.py").write_bytes(FILES["package/drive.py"].replace(b"...", b"0.0"))


def _append(files: Path) -> None:
    with (files / "robot.xml").open("ab") as file:
        file.write(b" ")


def _cut(files: Path) -> None:
    (files / "robot.xml").write_bytes(b"<mujoco")


def _add(files: Path) -> None:
    (files / "package/__pycache__").mkdir()


def _remove(files: Path) -> None:
    (files / "package/run.sh").unlink()


def _link(files: Path) -> None:
    (files / "robot.xml").rename(files.parent / "elsewhere.xml")
    (files / "robot.xml").symlink_to(files.parent / "elsewhere.xml")


def _link_folder(files: Path) -> None:
    (files / "package").rename(files.parent / "elsewhere")
    (files / "package").symlink_to(files.parent / "elsewhere")


@pytest.mark.parametrize("write", [_rewrite, _append, _cut, _add, _remove, _link, _link_folder, lambda _files: None])
def test_files_that_were_written_to_are_not_used(write: Callable[[Path], None], sealed: tuple[Path, str]) -> None:
    entry, digest = sealed
    open_to_writing(entry / "files")

    write(entry / "files")

    assert sealed_files(entry, digest) is None
    assert changed_bundle(entry / "files")
    assert stored_archive(entry, digest) is not None


def test_an_archive_that_was_changed_together_with_the_files_is_not_used(
    sealed: tuple[Path, str], tmp_path: Path
) -> None:
    entry, digest = sealed
    other, _ = archive(tmp_path, FILES | {"robot.xml": b"<mujoco></mujoco>"})
    discard_bundle(entry)
    forged = seal_bundle(other, tmp_path / "cache" / "forged", hashlib.sha256(other.read_bytes()).hexdigest()).parent

    forged.rename(entry)

    assert sealed_files(entry, digest) is None
    assert stored_archive(entry, digest) is None


def test_sealing_again_puts_away_what_was_changed(sealed: tuple[Path, str], tmp_path: Path) -> None:
    entry, digest = sealed
    open_to_writing(entry / "files")
    _rewrite(entry / "files")

    files = seal_bundle(archive(tmp_path)[0], entry, digest)

    assert (files / "package/drive.py").read_bytes() == FILES["package/drive.py"]
    assert [path.name for path in entry.parent.iterdir()] == [digest]


def test_an_archive_with_another_digest_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    path, _ = archive(tmp_path)
    (tmp_path / "cache").mkdir()

    with pytest.raises(BundleRefused, match="was changed or cut short"):
        seal_bundle(path, tmp_path / "cache" / ("0" * 64), "0" * 64)

    assert list((tmp_path / "cache").iterdir()) == []


def test_only_the_very_files_of_an_application_that_comes_with_simyard_are_its(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    copy = shutil.copytree(ROOT / "applications/courier", tmp_path / "copy")
    assert is_shipped(copy)
    changed = copy / "courier/go_to_goal.py"
    changed.write_bytes(changed.read_bytes()[:-1] + b" ")
    assert not is_shipped(copy)
    changed.unlink()
    changed.symlink_to(ROOT / "applications/courier/courier/go_to_goal.py")
    assert not is_shipped(copy)
    changed.unlink()
    monkeypatch.setattr(Path, "read_bytes", None)  # a bundle of other files is not read: it may be large
    assert not is_shipped(copy)
    assert not is_shipped(tmp_path / "none")
