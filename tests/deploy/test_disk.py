from pathlib import Path

from specs.deployment import DeploymentLaunchConfig
from tasks.deploy.disk import Disk, RobotState
from tasks.deploy.states import Desired


def _desired(digest: str) -> Desired:
    return Desired(
        robot="r1",
        deployment="dep-1",
        sequence=3,
        epoch=1,
        application="courier",
        version=1,
        digest=digest * 64,
        launch=DeploymentLaunchConfig(packageName="courier", launchFile="run.sh"),
        environment={"A": "1"},
        timeout_s=60.0,
        issued_at_s=1.0,
    )


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
