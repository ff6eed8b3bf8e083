"""`simyard plan` tells engine and reason, chunks, a range of time and memory, audit and recordings."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from flows.pipeline import world_imports
from flows.preview.plan import (
    HostPlan,
    SeenSpread,
    host_failures,
    host_faults,
    host_lines,
    plan_lines,
    seen_spread,
    world_lines,
)
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.documents.pipeline_file import read_pipeline
from tasks.results.playback import replay_formats
from tasks.results.tables.history_rows import Cell
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.simulate.forecast import forecast
from tasks.simulate.forecast.forecast import nodes_pace, nodes_s
from tasks.simulate.sandbox import launch_check
from tasks.simulate.sandbox.confinement import Confinement
from tasks.simulate.sandbox.launch_check import LaunchReport, check_launch_file
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import submit
from tasks.worlds.importer.import_process import import_source
from tests.deploy.puppets import PuppetRobots
from tests.deploy.yard import FLEET, STAYS_UP, Yard
from tests.factories.ros_maps import write_map
from tests.repository import ROOT
from tests.ros.conftest import ros
from tests.simulate.forecast.test_batch_times import WARM

Tell = Callable[..., str]


@pytest.fixture
def lines(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Tell:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))

    def tell(**batch: object) -> str:
        spec = read_pipeline(ROOT / "examples/quickstart.yaml")
        assert spec.simulationBatch
        section = type(spec.simulationBatch).model_validate(
            {**spec.simulationBatch.model_dump(mode="json", exclude_none=True), **batch}
        )
        changed = spec.model_copy(update={"simulationBatch": section})
        return "\n".join(plan_lines(changed, ROOT / "examples", file_store))

    return tell


def test_robots_that_share_a_world_are_told(lines: Tell):
    told = lines(robots=3)
    assert "1,152 episodes of at most 60 simulated seconds" in told
    assert "3 robots share a world, 384 times; each is an episode; none is audited" in told
    assert "6 chunks of 192 lanes" in told
    assert "; no audit" in told


def test_the_quickstart_is_told_before_it_runs(lines: Tell):
    told = lines()
    assert "worldGeneration   48 worlds (48 floor plans x 1 interior), seed 7" in told
    assert "384 episodes of at most 60 simulated seconds" in told
    line = next(line.strip() for line in told.splitlines() if "if 2 % collide" in line)
    assert f"`{line}`" in " ".join((ROOT / "README.md").read_text().split())
    assert "courier: engine planar, the fastest of all" in told
    assert re.search(r"2 chunks of 192 lanes on \d+ cpu devices?, 1 compiled program,", told)
    assert re.search(r"unknown .*: perhaps \S+ to \S+ (s|min|h) and \S+ to \S+ GB of memory", told)
    assert "recordings of failed episodes at 10 Hz; 32 episodes audited on C MuJoCo" in told


def test_how_long_it_may_compile_is_told_where_that_is_long(lines: Tell, monkeypatch: pytest.MonkeyPatch):
    cold = WARM.model_copy(update={"chunks_s": 42.0, "compile_s": 32.0})
    for known, compiling in (([WARM], ""), ([cold, WARM], "; up to 31 s more where it has to compile, as for worlds")):
        monkeypatch.setattr(forecast, "recall_batches", lambda _plan, known=known: known)
        told = lines()
        assert f"; from the last batch of these programs here{compiling}" in told
        assert ("has to compile" in told) == bool(compiling)


def test_programs_are_counted_for_each_size_of_imported_worlds(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(world_imports, "_read_apart", lambda asked, _path, _folders: import_source(asked))
    for name, cells in (("room", 40), ("hall", 400)):
        (tmp_path / name).mkdir()
        write_map(tmp_path / name, ("#" * cells, *("#" + "." * (cells - 2) + "#",) * 38, "#" * cells))
    sections = read_pipeline(ROOT / "examples/own-building.yaml").model_dump(mode="json", exclude_none=True)
    batch = sections["simulationBatch"] | {"matrix": {"worlds": "all", "seeds": 1}}
    worlds = [{"name": name, "source": f"{name}/map.yaml"} for name in ("room", "hall")]
    spec = PipelineSpec.model_validate({"name": "sizes", "worlds": worlds, "simulationBatch": batch})
    assert "1 compiled program for each of 2 sizes of worlds," in "\n".join(plan_lines(spec, tmp_path, file_store))


def test_a_variable_that_no_application_names_is_told(file_store: Store):
    sections = read_pipeline(ROOT / "examples/people.yaml").model_dump(mode="json", exclude_none=True)
    variables = {"MAX_SPEDE": ["0.4"], "MAX_SPEED": ["1"]}
    sections["simulationBatch"]["matrix"] = {"worlds": "all", "seeds": 1, "environmentVariables": variables}
    told = plan_lines(PipelineSpec.model_validate(sections), ROOT / "examples", file_store)
    assert [line for line in told if line.startswith("no effect?")] == [
        'no effect?        MAX_SPEDE: no file of courier or delivery has this name; did you mean "MAX_SPEED"?'
    ]


def test_what_is_turned_off_is_said(lines: Tell):
    told = lines(recordings={"episodes": "none"}, audit={"lanes": 0}, engine="mujoco")
    assert "courier: engine mujoco, asked for" in told
    assert "no recordings; no audit" in told


def test_requests_that_record_everything_are_told(lines: Tell):
    spec = read_pipeline(ROOT / "examples/quickstart.yaml")
    assert spec.simulationBatch
    (request,) = spec.simulationBatch.createSimulationJobRequests
    asked = {**request.model_dump(mode="json", exclude_none=True), "loggingConfig": {"recordAllRosTopics": True}}
    told = lines(createSimulationJobRequests=[asked])
    assert "at 10 Hz, and all of 1 request with recordAllRosTopics, bags as rosbag;" in told


def test_that_pictures_are_kept_is_told(lines: Tell):
    assert "failed episodes at 10 Hz, pictures at 2 Hz;" in lines(recordings={"picturesHz": 2})


def test_the_formats_of_bags_are_told_or_what_is_missing(lines: Tell, monkeypatch: pytest.MonkeyPatch):
    asked = {"episodes": "failed", "bags": ["rosbag", "rosbag2"]}
    assert "recordings of failed episodes at 10 Hz, bags as rosbag and rosbag2;" in lines(recordings=asked)
    monkeypatch.setattr(replay_formats, "find_spec", lambda _: None)
    with pytest.raises(DocumentError, match=r"simulationBatch.recordings.bags: rosbag: .*simyard\[ros\]"):
        lines(recordings=asked)


UNDRIVEN = """
<mujoco><worldbody><body name="base"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" axis="0 0 1"/><geom size="0.2" pos="0 0 0.2"/>
</body></worldbody></mujoco>"""


def own_robots(folder: Path, **models: str) -> PipelineSpec:
    """Returns a document that drives robots of its own."""
    for name, model in models.items():
        robot = shutil.copytree(ROOT / "applications/courier", folder / name)
        (robot / "robot.xml").write_text(model)
    quickstart = read_pipeline(ROOT / "examples/quickstart.yaml").model_dump(mode="json", exclude_none=True)
    request = quickstart["simulationBatch"]["createSimulationJobRequests"][0]
    (launch,) = request["robotApplications"]
    requests = [{**request, "robotApplications": [{**launch, "application": name}]} for name in models]
    batch = {**quickstart["simulationBatch"], "createSimulationJobRequests": requests}
    sources = [{"name": name, "source": str(folder / name)} for name in models]
    template = str(ROOT / "examples/templates/two-rooms.json")
    generation = {**quickstart["worldGeneration"], "template": template}
    return PipelineSpec.model_validate(
        {"name": "own", "applications": sources, "worldGeneration": generation, "simulationBatch": batch}
    )


def test_all_robots_that_no_engine_takes_are_faults_before_the_first_line(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    courier = (ROOT / "applications/courier/robot.xml").read_text()
    spec = own_robots(tmp_path, one=UNDRIVEN, two=courier, three=UNDRIVEN)
    with pytest.raises(DocumentError) as caught:
        next(plan_lines(spec, tmp_path, file_store))
    assert [Path(fault.value).name for fault in caught.value.faults] == ["one", "three"]
    assert "no actuator: nothing could drive the robot" in caught.value.faults[0].allowed


def test_a_refusal_is_one_fault_without_its_heading_and_an_error_of_xml_is_one_line(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    driven = UNDRIVEN.replace("</worldbody>", '</worldbody><actuator><motor joint="x"/></actuator>')
    boxed = driven.replace('<geom size="0.2"', '<geom type="box" size="0.2 0.2 0.1"')
    spec = own_robots(tmp_path, box=boxed)
    section = spec.simulationBatch
    assert section
    spec = spec.model_copy(update={"simulationBatch": section.model_copy(update={"engine": "planar"})})
    with pytest.raises(DocumentError) as caught:
        next(plan_lines(spec, tmp_path, file_store))
    (box,) = caught.value.faults
    assert box.allowed.startswith("a robot that an engine takes, and not this one: robot.xml: ")
    with pytest.raises(DocumentError) as caught:
        next(plan_lines(own_robots(tmp_path, typo=UNDRIVEN.replace("<geom", "<sight")), tmp_path, file_store))
    (typo,) = caught.value.faults
    assert re.fullmatch(r"robot\.xml: .*unrecognized element.*sight.*", typo.allowed)


def test_what_is_strange_in_a_robot_and_drives_all_the_same_is_told(file_store: Store, tmp_path: Path):
    courier = (ROOT / "applications/courier/robot.xml").read_text()
    spec = own_robots(tmp_path, wide=courier.replace('pos="0.15 0 0.08"', 'pos="0.2 0 0.08"'))
    told = "\n".join(plan_lines(spec, tmp_path, file_store))
    assert "wide: strange: geom 'nose' reaches 0.25 m from its axis, and what collides 0.18 m" in told


def test_what_a_camera_costs_is_told_with_the_time_without_it(file_store: Store, tmp_path: Path):
    spec = own_robots(tmp_path, robot=(ROOT / "applications/courier/robot.xml").read_text())
    (module,) = (each for each in tmp_path.rglob("*.py") if "def controller(" in each.read_text())
    seeing = "class Eye:\n    columns, rows, rate_hz = 64, 48, 10.0\n\n\nclass Seer:\n    depth_camera = Eye()\n"
    blind = module.read_text()
    module.write_text(f"{blind}\n\n{seeing}")
    told = "\n".join(plan_lines(spec, tmp_path, file_store))
    pictures = r"depth_camera of 64x48 at 10 Hz: [\d,]+ to [\d,]+ pictures a second of a core"
    line = pictures + r"; at most \S+ to \S+ (s|min|h), without it \S+ to"
    assert re.search(line, told), told

    module.write_text(f"{blind}\n\n{seeing.replace('64, 48, 10.0', '2, 2, 0.1')}")
    told = "\n".join(plan_lines(spec, tmp_path, file_store))
    assert re.search(r"depth_camera of 2x2 at 0.1 Hz: .* a second of a core; less than a second\n", told), told


def test_rows_of_c_mujoco_itself_are_driven_twice_and_not_audited(lines: Tell):
    assert "32 episodes driven twice, and no audit: mujoco is the reference itself" in lines(engine="mujoco")


def test_a_large_batch_is_told_in_hours_and_whole_numbers(lines: Tell):
    told = lines(matrix={"seeds": 2_000, "environmentVariables": {"MAX_SPEED": ["0.6"]}}, engine="mujoco")
    assert "96,000 episodes" in told
    assert re.search(r"perhaps \S+ to \S+ h and", told)
    assert "500 chunks of 192 lanes" in told


def test_the_gates_page_is_planned_with_the_tested_versions_episodes(file_store: Store, tmp_path: Path):
    for number in range(4):
        robot = tmp_path / f"courier-{number}"
        shutil.copytree(ROOT / "applications/courier", robot, ignore=shutil.ignore_patterns("__pycache__"))
        (robot / "CHANGES").write_text(str(number))
        publish_bundle(file_store, "robot-application", "courier", robot)
    publish_bundle(file_store, "simulation-application", "delivery", ROOT / "applications/delivery")
    page = (ROOT / "docs/guide/gate.md").read_text()
    block = re.findall(r"```yaml\n(simulationBatch:.*?)```", page, re.DOTALL)[0]
    template = ROOT / "examples/templates/two-rooms.json"
    worlds = f"worldGeneration: {{template: {template}, worldCount: {{floorplanCount: 8}}}}"
    document = tmp_path / "gate.yaml"
    document.write_text(f"name: gate\n{worlds}\n{block}")
    told = "\n".join(plan_lines(read_pipeline(document), ROOT / "examples", file_store))
    tested = re.findall(r"courier version (\d): engine planar", told)
    assert tested == ["4", "3"]
    assert "8 x 24 = 192 pairs then, and 384 episodes" in " ".join(page.split())
    assert "384 episodes" in told
    assert "if equal, and 0 % end otherwise, 189 driven by both give 90 % power: 192 are ENOUGH" in told


def test_a_deployment_is_told_with_its_waves_its_threshold_and_a_robots_time(file_store: Store, tmp_path: Path):
    create_fleet(file_store, FLEET)
    PuppetRobots(file_store, 5)
    create_robot(file_store, "tagged", tags={"site": "kitchen"})
    register_robot(file_store, FLEET, "tagged")
    yard = Yard(file_store, tmp_path)
    for script in (STAYS_UP, f"{STAYS_UP}# better"):
        yard.publish({"run.sh": script})
    document = tmp_path / "deploy.yaml"
    document.write_text(
        f"""name: courier
deployment:
  fleet: {FLEET}
  trust: unsigned
  deploymentConfig: {{concurrentDeploymentPercentage: 40, failureThresholdPercentage: 50}}
  rollOut: {{canaryRobots: 1, leastExecutedRobots: 2}}
  deploymentApplicationConfigs:
    - {{application: courier, launchConfig: {{packageName: courier, launchFile: run.sh}}}}
"""
    )
    told = "\n".join(plan_lines(read_pipeline(document), tmp_path, file_store))
    assert f"courier (newest version, 2) to fleet {FLEET}, bundle" in told
    assert "robots get tags as variables, which no episode has: AWS_ROBOMAKER_ROBOT_TAG_KEY_site\n" in told
    assert "6 robots, the first 1 of them canaries, at most 2 at once: at least 4 waves" in told
    assert "failures that stop it: 3 once 2 have ended, one of a canary at once; a robot has 18,000 s" in told


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

    if launch_check.confinement().level != "process":
        assert not (tmp_path / "ran").exists()


HERE = Gate.model_validate({"successRate": {"atLeast": 0.9}})
OVER = Gate.model_validate({"successRate": {"atLeast": 0.9, "over": "worlds"}})


def told(gate: Gate, seen: SeenSpread | None, worlds: int = 8, seeds: int = 24) -> list[str]:
    return list(world_lines(gate, seen, episodes=384, worlds=worlds, seeds=seeds))


def test_where_no_rule_is_about_worlds_and_none_were_seen_to_differ_nothing_is_said():
    assert told(HERE, None) == []
    assert told(HERE, SeenSpread(3, 0.0)) == []


def test_without_an_earlier_batch_the_worth_is_said_for_three_correlations():
    assert told(OVER, None)[0] == (
        "no earlier batch: 8 worlds x 48 episodes are worth 384 / 115 / 67 independent ones at an ICC of 0 / 0.05 / 0.1"
    )


def test_earlier_batches_say_what_the_layout_is_worth_and_what_to_write():
    lines = told(HERE, SeenSpread(3, 0.14))
    assert lines[0].startswith("3 earlier batches: ICC 0.14; 8 worlds x 48 episodes are worth 51 independent ones")
    assert lines[-1] == "192 worlds x 2 would be worth 337: write worldCount: {floorplanCount: 192} and seeds: 1"


def test_a_layout_that_is_hardly_better_is_not_advised():
    assert len(told(OVER, SeenSpread(1, 0.05), 48, 4)) == 1
    assert len(told(OVER, None, 384, 1)) == 1


def test_no_more_worlds_are_advised_than_a_document_may_have():
    lines = list(world_lines(OVER, None, episodes=50_000, worlds=50, seeds=1_000))
    assert "write worldCount: {floorplanCount: 10000} and seeds: 5" in lines[-1]
    assert not any("50000" in line.partition("write")[2] for line in lines)


def test_the_spread_of_earlier_batches_is_that_of_their_worlds(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    assert seen_spread(file_store, "nightly") is None
    submit(file_store, "pipeline-run", {}, "run")
    cells = tuple(Cell(f"g/{world}", "b", (), passed, 8) for world, passed in enumerate([8, 8, 8, 0]))
    night = SimpleNamespace(cells=cells, request="r", begun_at_s=1.0)
    monkeypatch.setattr("flows.batch.trend_history.read_history", lambda *_: SimpleNamespace(nights=[night]))
    assert seen_spread(file_store, "nightly") == SeenSpread(1, 1.0)
    perfect = SimpleNamespace(cells=(Cell("g/a", "b", (), 8, 8),), request="r", begun_at_s=2.0)
    monkeypatch.setattr("flows.batch.trend_history.read_history", lambda *_: SimpleNamespace(nights=[perfect]))
    assert seen_spread(file_store, "nightly") == SeenSpread(1, None)
