"""How many lanes with processes of their own a machine holds: by its memory and cores, and never fewer than eight."""

from pathlib import Path

import pytest

from tasks.ros.ros2.dds_domain import DOMAINS, episode_domains
from tasks.simulate.host import declaration
from tasks.simulate.host.declaration import available_bytes, most_lanes
from tests.factories.simulations import FOLDERS, delivery
from tests.simulate.host.fake_lockstep import BUNDLE, ROS_ROBOT, ros_bundle


def told(folder: Path, memory: str, limit: str = "", used: str = "") -> Path:
    (folder / "proc").mkdir()
    (folder / "proc/meminfo").write_text(memory)
    if limit:
        (folder / "sys/fs/cgroup").mkdir(parents=True)
        (folder / "sys/fs/cgroup/memory.max").write_text(limit)
        (folder / "sys/fs/cgroup/memory.current").write_text(used)
    return folder


def test_controllers_without_processes_are_not_bounded():
    assert most_lanes([delivery(0, world="hand/one")], FOLDERS) is None


@pytest.mark.parametrize(("free", "most"), [(1 << 20, 8), (20 * (128 << 20), 12), (1 << 50, 16)])
def test_lanes_of_ros_are_bounded_by_memory_and_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, most: int
):
    monkeypatch.setattr(declaration, "available_bytes", lambda: free)
    monkeypatch.setattr(declaration.os, "sched_getaffinity", lambda _: {0})
    asked = [delivery(0, world="hand/one").model_copy(update={"robot": ROS_ROBOT})]
    assert most_lanes(asked, {BUNDLE: ros_bundle(tmp_path / "bundle")}) == most


@pytest.mark.parametrize(("name", "most"), [("drive.launch", 1024), ("drive.launch.py", 96)])
def test_lanes_of_ros_2_are_never_more_than_there_are_domains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, most: int
):
    monkeypatch.setattr(declaration, "available_bytes", lambda: 1 << 50)
    monkeypatch.setattr(declaration.os, "sched_getaffinity", lambda _: {*range(64)})
    bundle = ros_bundle(tmp_path / "bundle")
    (bundle / "patrol/launch/drive.launch.py").touch()
    robot = ROS_ROBOT.model_copy(update={"launch_file": name})
    asked = [delivery(0, world="hand/one").model_copy(update={"robot": robot})]
    assert most_lanes(asked, {BUNDLE: bundle}) == most
    assert most > len(DOMAINS) or episode_domains(most)


def test_memory_is_what_is_free_of_the_machine(tmp_path: Path):
    assert available_bytes(told(tmp_path, "MemTotal: 9 kB\nMemAvailable:   5 kB\n")) == 5 << 10


@pytest.mark.parametrize(("limit", "free"), [("3000", 1000), ("max", 5 << 10), ("1000", 0)])
def test_a_container_may_have_less(tmp_path: Path, limit: str, free: int):
    assert available_bytes(told(tmp_path, "MemAvailable: 5 kB\n", limit, "2000")) == free


def test_a_machine_that_tells_nothing_has_none(tmp_path: Path):
    assert available_bytes(tmp_path) == 0
