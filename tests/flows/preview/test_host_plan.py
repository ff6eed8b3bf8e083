"""What a plan says of ROS launch files: faults, lines, and what is missing."""

from pathlib import Path

import pytest

from flows.preview.plan import HostPlan, host_failures, host_faults, host_lines
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.simulate.forecast.forecast import nodes_pace, nodes_s
from tasks.simulate.sandbox import launch_check
from tasks.simulate.sandbox.confinement import Confinement
from tasks.simulate.sandbox.launch_check import LaunchReport, check_launch_file
from tests.ros.conftest import ros

__all__ = ["ros"]

SOURCE = LaunchSource(Path("b"), "roamer", "roam.launch")
REPORT = LaunchReport(ros="ROS 1 noetic", has_ros=True, nodes=("/roam (roamer roam.py)", "/tf (roamer tf.py)"))


def test_a_launch_file_that_roslaunch_refuses_is_a_fault_for_each_reason():
    refused = REPORT.model_copy(update={"refusals": ("no node", "no package")})
    faults = host_faults(HostPlan({SOURCE: refused}))
    assert [(fault.value, fault.allowed.rpartition(": ")[2]) for fault in faults] == [
        ("'roam.launch'", "no node"),
        ("'roam.launch'", "no package"),
    ]


def test_a_wrong_declaration_is_a_fault_whether_or_not_ros_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "ros.yaml").write_text("lidr: {}\n")
    monkeypatch.setattr(launch_check, "_ros1_report", lambda *_, **__: LaunchReport(ros="no ROS", has_ros=False))
    source = LaunchSource(tmp_path, "roamer", "roam.launch")
    (fault,) = host_faults(HostPlan({source: check_launch_file(source, [{}], own=True)}))
    assert fault.path.endswith("launchConfig.packageName")
    assert "ros.yaml: lidr" in fault.allowed


def test_nodes_processes_and_pace_are_told():
    lines = "\n".join(host_lines(HostPlan({SOURCE: REPORT}), 8))
    assert "starts /roam (roamer roam.py), /tf (roamer tf.py)" in lines
    assert "8 lanes at once: 16 processes of up to 0.7 GB together" in lines


def test_without_ros_jobs_will_fail_and_what_to_install_is_said():
    missing = LaunchReport(ros="ROS 1 is not there: apt-get install ros-core", has_ros=False)
    assert host_failures(HostPlan({SOURCE: missing})) == ["ROS 1 is not there: apt-get install ros-core"]
    assert host_failures(HostPlan({SOURCE: REPORT})) == []


def test_more_lanes_take_more_time_and_more_chunks_too():
    assert nodes_s(64, 32, 1200).high > nodes_s(32, 32, 1200).high > nodes_s(8, 8, 1200).high
    assert nodes_pace(8, 1).high > nodes_pace(1, 1).high


@pytest.mark.usefixtures("ros")
def test_another_ones_launch_file_is_not_read_where_nothing_shuts_it_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(launch_check, "confinement", lambda: Confinement("process", "as told"))
    (tmp_path / "evil").mkdir()
    (tmp_path / "evil/package.xml").write_text("<package><name>evil</name></package>")
    (tmp_path / "evil/go.launch").write_text(f'<launch><param name="p" command="touch {tmp_path}/ran"/></launch>')

    report = check_launch_file(LaunchSource(tmp_path, "evil", "go.launch"), [{}], own=False)

    assert "install bubblewrap" in report.unread
    assert not (tmp_path / "ran").exists()


@pytest.mark.long
@pytest.mark.usefixtures("ros")
def test_a_launch_file_is_read_where_it_can_change_nothing(tmp_path: Path):
    (tmp_path / "evil").mkdir()
    (tmp_path / "evil/package.xml").write_text("<package><name>evil</name></package>")
    command = f"sh -c 'touch {tmp_path}/ran; echo x'"
    (tmp_path / "evil/go.launch").write_text(f'<launch><param name="p" command="{command}"/></launch>')

    check_launch_file(LaunchSource(tmp_path, "evil", "go.launch"), [{}], own=False)

    if launch_check.confinement().level == "bubblewrap":
        assert not (tmp_path / "ran").exists()
