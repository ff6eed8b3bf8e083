"""What goes of this machine's cache."""

import os
import shutil
from pathlib import Path

import pytest

from tasks.housekeeping import machine
from tasks.housekeeping.machine import CacheEntry, remove_entry, unused_entries

_DAY_S = 86400.0


def cached(cache: Path, name: str, *, days: float) -> Path:
    """Returns a file that was written and read last so many days ago, with the folders that it made."""
    path = cache / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"12345")
    age(path, days)
    top = path.parent
    while top != cache:
        age(top, days)
        top = top.parent
    return path


def age(path: Path, days: float) -> None:
    then_s = path.stat().st_ctime - days * _DAY_S
    os.utime(path, (then_s, then_s))


def found(cache: Path) -> list[tuple[str, str]]:
    return [(entry.what, entry.path.name) for entry in unused_entries(cache, 30 * _DAY_S)]


@pytest.mark.parametrize(
    "folder", ["programs", "bundles/digest", "data/objects", "data/mounts/digest/files", "engines", "timings"]
)
def test_what_nobody_has_used_for_long_goes_with_all_that_is_in_it(tmp_path: Path, folder: str) -> None:
    path = cached(tmp_path, f"{folder}/file", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    assert entry.size_bytes == 5
    assert remove_entry(entry)
    assert not path.exists()
    assert list(entry.path.parent.iterdir()) == []


def test_what_was_written_or_read_lately_stays(tmp_path: Path) -> None:
    old = cached(tmp_path, "bundles/read/package/file", days=40)
    os.utime(old, (old.stat().st_ctime, old.stat().st_mtime))
    cached(tmp_path, "bundles/written/package/file", days=2)
    assert found(tmp_path) == []


@pytest.mark.parametrize("name", ["keys/store/root.pem", "agents/store/robot/state.json", "prefect/prefect.db", "mine"])
def test_keys_robots_prefect_and_what_is_not_known_stay(tmp_path: Path, name: str) -> None:
    cached(tmp_path, name, days=400)
    assert found(tmp_path) == []


def test_what_killed_processes_left_in_it_goes_too(tmp_path: Path) -> None:
    cached(tmp_path, "bundles/.download-x/bundle.tar", days=31)
    cached(tmp_path, "data/mounts/.digest.0.tmp/files/a", days=31)
    assert [what for what, _ in found(tmp_path)] == ["unpacked bundles", "data mounts"]


def test_folders_that_are_read_only_are_removed(tmp_path: Path) -> None:
    path = cached(tmp_path, "data/mounts/digest/files/a", days=31)
    path.chmod(0o444)
    path.parent.chmod(0o555)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    assert remove_entry(entry)
    assert not entry.path.exists()


def test_what_was_used_since_it_was_seen_stays(tmp_path: Path) -> None:
    path = cached(tmp_path, "bundles/digest/file", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    os.utime(path)
    assert not remove_entry(entry)
    assert path.read_bytes() == b"12345"


def test_what_another_gc_has_removed_is_gone(tmp_path: Path) -> None:
    assert remove_entry(CacheEntry(tmp_path / "bundles/none", "unpacked bundles", 0, 0.0))


def test_no_cache_has_nothing_to_spare(tmp_path: Path) -> None:
    assert unused_entries(tmp_path / "none", 0.0) == []


def test_a_file_that_is_written_anew_before_the_old_one_is_put_back_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = cached(tmp_path, "timings/machine", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    os.utime(path)
    seen = machine.CacheEntry(path, entry.what, 5, entry.used_s + 1.0)

    def written_anew(_aside: Path, _what: str) -> CacheEntry:
        path.write_bytes(b"newer")
        return seen

    monkeypatch.setattr(machine, "_seen", written_anew)
    assert not remove_entry(entry)
    assert path.read_bytes() == b"newer"
    assert list(path.parent.iterdir()) == [path]


def test_a_folder_that_another_gc_takes_away_meanwhile_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cached(tmp_path, "bundles/digest/file", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    real = shutil.rmtree

    def taken_away(path: Path, **options: object) -> None:
        path.rename(path.with_name(".gc-another"))
        real(path, **options)  # pyright: ignore[reportArgumentType, reportCallIssue] - passed on as it came

    monkeypatch.setattr(machine.shutil, "rmtree", taken_away)
    assert remove_entry(entry)
    assert not entry.path.exists()
