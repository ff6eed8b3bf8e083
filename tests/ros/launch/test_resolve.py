"""What roslaunch says of launch files: nodes, parameters, and refusals in words."""

from pathlib import Path
from xmlrpc.client import Binary

import pytest

from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchPlan, LaunchSource, resolve

pytestmark = pytest.mark.long


@pytest.fixture
def bundle(courier: Path, tmp_path: Path) -> Path:
    (tmp_path / "courier").symlink_to(courier / "courier")
    own = tmp_path / "own"
    (own / "launch").mkdir(parents=True)
    (own / "package.xml").write_text("<package><name>own</name></package>")
    program = own / "tool.sh"
    program.write_text("#!/bin/sh\nsleep 60\n")
    program.chmod(0o755)
    return tmp_path


def plan(bundle: Path, text: str, **variables: str) -> LaunchPlan:
    (bundle / "own/launch/x.launch").write_text(f"<launch>{text}</launch>")
    return only(resolve(LaunchSource(bundle, "own", "x.launch"), [variables]))


def only(found: list[LaunchPlan | LaunchRefused]) -> LaunchPlan:
    (one,) = found
    if isinstance(one, LaunchRefused):
        raise one
    return one


def test_each_environment_has_its_own_plan(courier: Path) -> None:
    fast, usual, again = resolve(LaunchSource(courier, "courier", "answer.launch"), [{"SPEED": "0.7"}, {}, {}])
    assert isinstance(fast, LaunchPlan)
    assert isinstance(usual, LaunchPlan)
    assert (fast.parameters, usual.parameters) == ({"/answer/speed": 0.7}, {"/answer/speed": 0.4})
    assert again is usual


@pytest.mark.parametrize("name", ["answer.launch", "launch/answer.launch"])
def test_a_file_is_found_below_its_package(courier: Path, name: str) -> None:
    found = only(resolve(LaunchSource(courier, "courier", name), [{}]))
    assert found.file == str(courier / "courier/launch/answer.launch")
    assert [node.name for node in found.nodes] == ["/answer"]


def test_groups_remaps_environments_and_prefixes_are_the_nodes(bundle: Path) -> None:
    node = '<node pkg="own" type="tool.sh" name="a" args="--x 1" launch-prefix="nice -n 1" required="true" cwd="node">'
    inside = '<remap from="scan" to="/front"/><env name="MODE" value="$(env WHO)"/><param name="p" value="2"/>'
    found = plan(bundle, f'<group ns="robot">{node}{inside}</node></group>', WHO="me").nodes[0]
    assert found.name == "/robot/a"
    assert found.command[:3] == ("nice", "-n", "1")
    assert {"--x", "1", "scan:=/front", "__name:=a"} <= set(found.command)
    assert found.own_environment() == {"MODE": "me", "ROS_NAMESPACE": "/robot"}
    assert found.required
    assert found.cwd.endswith("own")


def test_included_files_and_loaded_parameters_count(bundle: Path) -> None:
    (bundle / "own/values.yaml").write_text("gains: {p: 1.5, i: [1, 2]}\n")
    (bundle / "own/launch/part.launch").write_text(
        '<launch><arg name="n"/><node pkg="own" type="tool.sh" name="$(arg n)"/></launch>'
    )
    found = plan(
        bundle,
        '<include file="$(find own)/launch/part.launch"><arg name="n" value="b"/></include>'
        '<rosparam command="load" file="$(find own)/values.yaml" ns="c"/>'
        '<param name="f" binfile="$(find own)/tool.sh"/>',
    )
    assert [node.name for node in found.nodes] == ["/b"]
    assert found.parameters["/c/gains/p"] == 1.5
    assert found.parameters["/c/gains/i"] == [1, 2]
    assert isinstance(found.parameters["/f"], Binary)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<node pkg="nowhere" type="x" name="a"/>', "no ROS package 'nowhere' in the bundle or in ROS: put it"),
        ('<node pkg="own" type="missing" name="a"/>', "missing"),
        ('<arg name="must"/><node pkg="own" type="tool.sh" name="$(arg must)"/>', "must"),
        ('<include file="$(find nowhere)/x.launch"/>', "no ROS package 'nowhere' in the bundle or in ROS: put it"),
        ("<node", "x.launch"),
        ("", "no node"),
        ('<node pkg="own" type="tool.sh" name="$(env WHO)"/>', "WHO"),
        (
            '<machine name="far" address="192.0.2.1" env-loader="/x"/>'
            '<node pkg="own" type="tool.sh" name="a" machine="far"/>',
            "one machine",
        ),
    ],
)
def test_what_cannot_be_run_is_refused_in_words(bundle: Path, text: str, words: str) -> None:
    with pytest.raises(LaunchRefused, match=words):
        plan(bundle, text)


def test_a_package_or_file_that_is_not_there_is_named(courier: Path) -> None:
    with pytest.raises(LaunchRefused, match="no ROS package 'nowhere'"):
        only(resolve(LaunchSource(courier, "nowhere", "x.launch"), [{}]))
    with pytest.raises(LaunchRefused, match=r"no launch file 'x\.launch'"):
        only(resolve(LaunchSource(courier, "courier", "x.launch"), [{}]))
