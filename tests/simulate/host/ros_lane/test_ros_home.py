"""The folder of a chunk's nodes goes with the chunk, or with the next one if its process was killed."""

import os
import tempfile
from pathlib import Path

import pytest

from tasks.simulate.host.ros_controllers import RosHome, remove_abandoned


@pytest.fixture(autouse=True)
def _temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def aged(path: Path) -> Path:
    os.utime(path, (0, 0))
    return path


def test_it_is_gone_with_all_that_lies_in_it():
    home = RosHome()
    (home.path / "log").mkdir()
    home.close()
    home.close()
    assert not home.path.exists()


def test_what_nodes_of_a_lane_printed_last_is_told_and_no_link_is_followed(tmp_path: Path):
    home, secret = RosHome(), tmp_path / "secret"
    secret.write_text("of the machine")
    log = home.path / "lane-3" / "log"
    log.mkdir(parents=True)
    (log / "wander.out").write_text("x" * 3000 + "\nhello\nworld\n")
    (log / "other.out").symlink_to(secret)
    said = home.printed(3).splitlines()
    assert said[1:] == ["wander: hello", "wander: world"]
    assert (len(said[0]), home.printed(4)) == (len("wander: ") + 1987, "")
    home.close()


def test_a_killed_processs_folder_is_removed_and_a_living_ones_kept(tmp_path: Path):
    living = RosHome()
    (living.path / "note").touch()
    aged(living.path)
    abandoned = tmp_path / "simyard-ros-abandoned"
    (abandoned / "log").mkdir(parents=True)
    aged(abandoned)
    remove_abandoned(tmp_path)
    assert living.path.exists()
    assert not abandoned.exists()
    living.close()


def test_a_folder_that_may_be_about_to_be_locked_is_kept(tmp_path: Path):
    (tmp_path / "simyard-ros-young").mkdir()
    remove_abandoned(tmp_path)
    assert (tmp_path / "simyard-ros-young").exists()


def test_what_is_no_such_folder_is_kept(tmp_path: Path):
    kept = tmp_path / "elsewhere"
    kept.mkdir()
    aged(kept)
    (tmp_path / "simyard-ros-link").symlink_to(kept)
    remove_abandoned(tmp_path)
    assert kept.exists()
    assert (tmp_path / "simyard-ros-link").is_symlink()
