import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import DocumentError
from tasks.applications.registry import pack
from tasks.storage.archives import extract

NAMES = st.text("abcXYZ019_-.é", min_size=1, max_size=8).filter(lambda name: name not in {".", ".."})
TREES = st.dictionaries(NAMES, st.tuples(st.binary(max_size=50), st.booleans()), min_size=1, max_size=6)


@given(tree=TREES)
def test_packing_and_unpacking_gives_the_same_files_back(
    tree: dict[str, tuple[bytes, bool]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    home = tmp_path_factory.mktemp("bundle")
    _write(home / "in", tree)

    (home / "bundle.tar").write_bytes(pack(home / "in"))
    extract(home / "bundle.tar", home / "out")

    assert _tree(home / "out") == _tree(home / "in") == tree


@given(tree=TREES)
def test_equal_folders_give_equal_bytes_whenever_they_were_made(
    tree: dict[str, tuple[bytes, bool]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    home = tmp_path_factory.mktemp("bundle")
    _write(home / "first", tree)
    _write(home / "second", dict(reversed(tree.items())))
    for path in (home / "second").iterdir():
        os.utime(path, (1, 1))
        path.chmod(path.stat().st_mode & ~0o044)

    assert pack(home / "first") == pack(home / "second")


def test_a_changed_executable_bit_changes_the_archive(tmp_path: Path) -> None:
    _write(tmp_path, {"run.sh": (b"", False)})
    before = pack(tmp_path)
    (tmp_path / "run.sh").chmod(0o755)

    assert pack(tmp_path) != before


def test_leavings_of_tools_change_nothing(tmp_path: Path) -> None:
    _write(tmp_path, {"run.py": (b"pass", False)})
    before = pack(tmp_path)
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__/run.cpython-311.pyc").write_bytes(b"compiled")

    assert pack(tmp_path) == before


def test_every_link_and_pipe_is_named_in_one_error(tmp_path: Path) -> None:
    (tmp_path / "package").mkdir()
    (tmp_path / "package/run.sh").write_text("#!/bin/sh\n")
    (tmp_path / "package/passwords").symlink_to("/etc/passwd")
    (tmp_path / "everything").symlink_to("/")
    os.mkfifo(tmp_path / "pipe")

    with pytest.raises(DocumentError) as caught:
        pack(tmp_path)

    assert [fault.path for fault in caught.value.faults] == ["everything", "package/passwords", "pipe"]


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_a_folder_without_files_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()

    with pytest.raises(DocumentError, match="a folder"):
        pack(tmp_path / name)


def _write(folder: Path, tree: dict[str, tuple[bytes, bool]]) -> None:
    folder.mkdir(exist_ok=True)
    for name, (body, executable) in tree.items():
        (folder / name).write_bytes(body)
        (folder / name).chmod(0o755 if executable else 0o644)


def _tree(folder: Path) -> dict[str, tuple[bytes, bool]]:
    return {path.name: (path.read_bytes(), bool(path.stat().st_mode & 0o100)) for path in folder.iterdir()}
