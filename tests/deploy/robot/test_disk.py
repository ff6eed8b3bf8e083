from pathlib import Path

import pytest

from tasks.deploy.fleet.states import Desired
from tasks.deploy.robot.disk import Disk, RobotState
from tests.deploy.yard import desired_state


def _desired(digest: str) -> Desired:
    return desired_state(sequence=3, digest=digest * 64, environment={"A": "1"})


def test_a_new_robot_remembers_nothing(tmp_path: Path) -> None:
    assert Disk(tmp_path / "robot").load() == RobotState()


def test_what_is_saved_is_what_is_loaded(tmp_path: Path) -> None:
    state = RobotState(sequence=3, target=_desired("a"), running=_desired("b"))
    Disk(tmp_path).save(state)

    assert Disk(tmp_path).load() == state


def test_a_state_that_cannot_be_read_is_set_aside(tmp_path: Path) -> None:
    (tmp_path / "state.json").write_text('{"sequence": 3, "written by": "another version"}')

    assert Disk(tmp_path).load() == RobotState()
    assert (tmp_path / "state.unreadable").is_file()


def test_the_link_shows_the_version_it_was_switched_to_last(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    for digest in ("a", "b"):
        disk.version(digest).mkdir()
        disk.switch(digest)

    assert disk.current.resolve() == disk.version("b").resolve()
    disk.switch(None)
    disk.switch(None)
    assert not disk.current.is_symlink()


def test_tidying_keeps_what_runs_what_comes_and_what_ran_before(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    for name in [letter * 64 for letter in "abcd"] + ["e" * 64 + ".1234.tmp"]:
        (disk.versions / name).mkdir()
    (disk.downloads / "half").write_bytes(b"x")

    disk.tidy(RobotState(target=_desired("a"), running=_desired("b"), previous=_desired("c")))

    assert sorted(path.name[0] for path in disk.versions.iterdir()) == ["a", "b", "c"]
    assert list(disk.downloads.iterdir()) == []


def test_what_is_half_unpacked_or_unused_of_an_image_is_tidied_away(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    for name in (".unpack-12345678", "f" * 64):
        (disk.images / ("a" * 64) / name).mkdir(parents=True)
    for name in ("used", "unused"):
        (disk.image_files / name).touch()
    (disk.images / ("a" * 64) / ("f" * 64) / "file").hardlink_to(disk.image_files / "used")

    disk.tidy(RobotState(target=_desired("a")))

    assert [path.name for path in (disk.images / ("a" * 64)).iterdir()] == ["f" * 64]
    assert [path.name for path in disk.image_files.iterdir()] == ["used"]


@pytest.mark.parametrize(
    "left", [None, b"", b"{", b'{"sequence": "x"}', b"\xff\xfe", b'{"sequence": 9, "written by": "x"}']
)
def test_the_sequence_outlives_the_state(left: bytes | None, tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.save(RobotState(sequence=7))
    disk.save(RobotState(sequence=8, running=_desired("b")))
    if left is None:
        (tmp_path / "state.json").unlink()
    else:
        (tmp_path / "state.json").write_bytes(left)

    assert Disk(tmp_path).load() == RobotState(sequence=7)  # so that the eighth is taken once more


@pytest.mark.parametrize("left", [b"", b"x", b"-"])
def test_a_sequence_that_cannot_be_read_harms_no_state_that_can(left: bytes, tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.save(RobotState(sequence=7))
    (tmp_path / "sequence").write_bytes(left)

    assert Disk(tmp_path).load() == RobotState(sequence=7)
    disk.save(RobotState(sequence=7))
    assert (tmp_path / "sequence").read_bytes() == b"7"


def test_of_downloads_only_what_has_arrived_of_one_bundle_is_kept(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.download("a" * 64).write_bytes(b"half")
    disk.tidy(RobotState())
    assert disk.download("a" * 64).read_bytes() == b"half"

    disk.download("b" * 64).write_bytes(b"half")

    assert [path.name[0] for path in disk.downloads.iterdir()] == ["b"]


def test_a_link_that_is_right_is_left_alone(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.version("a" * 64).mkdir()
    disk.switch("a" * 64)
    before = disk.current.lstat().st_ino
    disk.switch("a" * 64)

    assert disk.current.lstat().st_ino == before


def test_the_state_is_the_agents_alone_also_if_an_older_one_was_not(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.save(RobotState(sequence=7))
    assert (tmp_path / "state.json").stat().st_mode & 0o777 == 0o600

    (tmp_path / "state.json").chmod(0o644)
    disk.load()
    assert (tmp_path / "state.json").stat().st_mode & 0o777 == 0o600

    (tmp_path / "state.json").chmod(0o666)
    disk.save(RobotState(sequence=8))
    assert (tmp_path / "state.json").stat().st_mode & 0o777 == 0o600
