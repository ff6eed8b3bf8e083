"""What a launch file asks of Gazebo, of plans as roslaunch resolves them."""

from pathlib import Path

import pytest

from specs.data.world import Start
from tasks.ros.launch.gazebo_launch import GazeboLaunch, read_gazebo_launch, started_nodes
from tasks.ros.launch.launch_plan import LaunchPlan, NodePlan

_MANIFEST = """<package format="2"><name>sim</name>
<export><gazebo_ros gazebo_model_path="${prefix}/things" gazebo_media_path="${prefix}"/></export></package>"""


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """A bundle with one package that exports its folders to Gazebo."""
    for name in ("worlds", "models", "things"):
        (tmp_path / "sim" / name).mkdir(parents=True)
    (tmp_path / "sim/package.xml").write_text(_MANIFEST)
    (tmp_path / "sim/worlds/hall.world").write_text("<sdf version='1.6'><world name='hall'/></sdf>")
    return tmp_path


def _server(*words: str) -> NodePlan:
    return NodePlan("/gazebo", "gazebo_ros", "gzserver", ("/x/gzserver", "-e", "ode", *words, "__name:=gazebo"))


def _spawner(*words: str, namespace: str = "/") -> NodePlan:
    return NodePlan("/spawn", "gazebo_ros", "spawn_model", ("/x/spawn_model", *words), namespace=namespace)


def _read(bundle: Path, *nodes: NodePlan, variables: dict[str, str] | None = None, **parameters: str) -> GazeboLaunch:
    given = {f"/{name}": value for name, value in parameters.items()}
    found = read_gazebo_launch(LaunchPlan("/x.launch", nodes, given), bundle, variables or {})
    assert found is not None
    return found


def test_a_launch_file_that_starts_nothing_of_gazebos_asks_for_nothing(bundle: Path) -> None:
    roam = NodePlan("/roam", "roamer", "roam.py", ("roam.py",))
    assert read_gazebo_launch(LaunchPlan("/x.launch", (roam,), {}), bundle, {}) is None


@pytest.mark.parametrize("name", ["worlds/hall.world", "hall.world", "{sim}/worlds/hall.world"])
def test_the_world_is_found_as_gazebo_finds_it(bundle: Path, name: str) -> None:
    found = _read(bundle, _server(name.format(sim=bundle / "sim")))
    assert found.world is not None
    assert found.world.samefile(bundle / "sim/worlds/hall.world")
    assert found.findings == ()


def test_a_world_that_is_not_there_is_a_finding(bundle: Path) -> None:
    found = _read(bundle, _server("worlds/attic.world"))
    assert found.world is None
    assert found.findings[0].startswith("the world worlds/attic.world is not there, looked for in ")


def test_a_world_outside_of_the_bundle_is_not_taken(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    outside = tmp_path_factory.mktemp("other") / "hall.world"
    outside.write_text("<sdf/>")
    found = _read(bundle, _server(str(outside)))
    assert found.world is None
    assert "outside the bundle" in found.findings[0]


def test_models_are_looked_for_where_variables_exports_and_packages_say(bundle: Path) -> None:
    (bundle / "more").mkdir()
    found = _read(bundle, _server(), variables={"GAZEBO_MODEL_PATH": f"{bundle / 'more'}:/nowhere"})
    names = [each.relative_to(bundle.resolve()).as_posix() for each in found.model_folders]
    assert names == ["more", "sim/things", "sim/models"]


def test_the_spawn_is_the_start_and_its_parameter_the_description(bundle: Path) -> None:
    words = ("-urdf", "-model", "bot", "-x", "3.5", "-y", "-1", "-Y", "1.57", "-param", "robot_description")
    found = _read(bundle, _server(), _spawner(*words), robot_description="<robot/>")
    assert (found.entity, found.spawn) == ("bot", Start(x_m=3.5, y_m=-1.0, yaw_rad=1.57))
    assert found.description == "<robot/>"


def test_a_description_may_be_a_file_or_a_model(bundle: Path) -> None:
    model = bundle / "sim/models/bot/model.sdf"
    model.parent.mkdir()
    model.write_text("<sdf/>")
    by_file = _read(bundle, _spawner("-sdf", "-model", "b", "-file", str(model)))
    by_name = _read(bundle, _spawner("-sdf", "-model", "b", "-database", "bot"))
    assert by_file.description == by_name.description == "<sdf/>"


def test_a_parameter_that_nobody_sets_and_a_second_model_are_findings(bundle: Path) -> None:
    crate = _spawner("-sdf", "-model", "crate", "-file", "/nowhere.sdf")
    found = _read(bundle, crate, _spawner("-urdf", "-model", "bot", "-param", "robot_description", namespace="/a/"))
    assert found.description is None
    assert [each.split(":")[0] for each in found.findings] == [
        "/spawn spawns crate, which is not taken",
        "/spawn spawns what the parameter /a/robot_description describes, and nobody sets it",
    ]


def test_all_other_nodes_run_and_each_of_gazebos_is_told(bundle: Path) -> None:
    roam = NodePlan("/roam", "roamer", "roam.py", ("roam.py",))
    rviz = NodePlan("/rviz", "rviz", "rviz", ("rviz",))
    client = NodePlan("/gazebo_gui", "gazebo_ros", "gzclient", ("gzclient",))
    found = _read(bundle, _server(), client, rviz, roam, _spawner("-model", "bot"))
    assert found.nodes == (roam,)
    assert [each.node for each in found.replaced] == [
        "/gazebo (gazebo_ros gzserver)",
        "/gazebo_gui (gazebo_ros gzclient)",
        "/rviz (rviz rviz)",
        "/spawn (gazebo_ros spawn_model)",
    ]


@pytest.mark.parametrize("command", [("driver", ""), ("/bin/sh", "-c", " ")])
def test_a_process_with_an_empty_word_is_none_of_gazebos(command: tuple[str, ...]) -> None:
    node = NodePlan("/driver", "", "", command)
    assert started_nodes(LaunchPlan("", (node,), {})) == (node,)


def test_windows_for_a_person_are_not_started_whatever_starts_them(bundle: Path) -> None:
    rviz, roam = NodePlan("/rviz", "rviz", "rviz", ("rviz",)), NodePlan("/roam", "roamer", "roam.py", ("roam.py",))
    plan = LaunchPlan("/x.launch", (rviz, roam), {})
    assert started_nodes(plan) == (roam,)
    found = read_gazebo_launch(plan, bundle, {})
    assert found is not None
    assert [each.node for each in found.replaced] == ["/rviz (rviz rviz)"]
