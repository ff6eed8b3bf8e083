"""What `simyard validate` can know without a store of what a document launches."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from flows.pipeline.bundle_checks import (
    check_confinement,
    check_launch_files,
    check_modules,
    check_own_bundles,
    check_policies,
    check_programs,
    check_robot_files,
    unchecked_references,
)
from flows.pipeline.references import resolve_references
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.simulate.plan.plan_batch import plan_batch
from tasks.simulate.sandbox import confinement
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.factories.policies import DECLARED, bundle, network, weights
from tests.repository import ROOT


def _use(application: str, package: str, file: str) -> dict[str, Any]:
    return {"application": application, "launchConfig": {"packageName": package, "launchFile": file}}


def _spec(folder: Path, robot: dict[str, Any], **sections: object) -> PipelineSpec:
    if not (folder / "mine").exists():
        shutil.copytree(ROOT / "applications/courier", folder / "mine", ignore=shutil.ignore_patterns("__pycache__"))
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [robot],
        "simulationApplications": [_use("delivery", "delivery", "rooms")],
    }
    batch = {"matrix": {"worlds": ["g/w"]}, "createSimulationJobRequests": [request]}
    own = [{"name": "mine", "source": "mine"}]
    return PipelineSpec.model_validate({"name": "n", "applications": own, "simulationBatch": batch, **sections})


def test_a_launch_file_that_the_own_bundle_does_not_have_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match=r"launchFile: 'go_to_gaol': a module in mine's bundle"):
        check_launch_files(_spec(tmp_path, _use("mine", "courier", "go_to_gaol")), tmp_path)


def test_a_script_that_the_own_bundle_does_not_have_is_refused(tmp_path: Path):
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [_use("mine", "courier", "walk.sh")]}
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"), deployment=deployment)
    with pytest.raises(DocumentError, match=r"deploymentApplicationConfigs\[0\].launchConfig.launchFile: 'walk.sh'"):
        check_launch_files(spec, tmp_path)


def test_each_file_of_the_own_bundle_that_a_robot_cannot_start_is_refused_with_what_to_do(tmp_path: Path):
    launch = {"packageName": "courier", "launchFile": "run.sh", "preLaunchFile": "first.sh", "postLaunchFile": "no.sh"}
    use = {"application": "mine", "launchConfig": launch}
    local = {"fleet": {"name": "team", "localAgents": 1}, "deploymentApplicationConfigs": [use]}
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"), deployment=local)
    (tmp_path / "mine/courier/run.sh").write_bytes(b"#!/bin/sh\r\nexec sleep 9\r\n")
    (tmp_path / "mine/courier/first.sh").write_text("#!/usr/bin/python2\n")
    with pytest.raises(DocumentError) as refused:
        check_programs(spec, tmp_path)
    assert [fault.allowed.removeprefix("a file that can be started; ") for fault in refused.value.faults] == [
        "mine/courier/first.sh is not executable: chmod +x mine/courier/first.sh",
        "mine/courier/run.sh, line 1: ends in CR LF, and the CR counts to the interpreter's name: "
        "dos2unix mine/courier/run.sh",
        "the bundle has no mine/courier/no.sh",
    ]
    (tmp_path / "mine/courier/first.sh").chmod(0o755)
    with pytest.raises(DocumentError, match=r"first\.sh, line 1: needs /usr/bin/python2, which this machine lacks"):
        check_programs(spec, tmp_path)


@pytest.mark.parametrize(
    ("changes", "paths"),
    [
        ({"robotApplications": None}, ["robotApplications"]),
        ({"simulationApplications": None}, ["simulationApplications"]),
        (
            {"robotApplications": [{"application": "mine", "launchConfig": {"environmentVariables": {"A": "1"}}}]},
            [f"robotApplications[0].launchConfig.{name}" for name in ("packageName", "launchFile")],
        ),
    ],
)
def test_what_cannot_be_driven_is_refused_without_a_store_in_the_words_of_a_plan(
    tmp_path: Path, changes: dict[str, Any], paths: list[str]
):
    document = _spec(tmp_path, _use("mine", "courier", "go_to_goal")).model_dump(mode="json", exclude_none=True)
    document["simulationBatch"]["createSimulationJobRequests"][0] |= changes
    spec = PipelineSpec.model_validate(document)
    assert spec.simulationBatch is not None

    with pytest.raises(DocumentError) as refused:
        check_own_bundles(spec, tmp_path)
    with pytest.raises(DocumentError) as planned:
        plan_batch(spec.simulationBatch, ("g/w",), {}, lambda *_: pytest.fail("looked up"))

    where = "simulationBatch.createSimulationJobRequests[0]"
    assert [fault.path for fault in refused.value.faults] == [f"{where}.{path}" for path in paths]
    assert refused.value.faults == planned.value.faults


def test_a_controller_that_is_no_python_is_refused_before_anything_imports_it(tmp_path: Path):
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"))
    module = tmp_path / "mine/courier/go_to_goal.py"
    module.write_text("x = 1\ndef controller(environment)\n")
    with pytest.raises(DocumentError, match=r"a module in Python .*; courier/go_to_goal.py, line 2: expected ':'"):
        check_own_bundles(spec, tmp_path)
    assert not list(tmp_path.rglob("*.pyc"))


def test_a_controller_that_would_not_import_is_refused_by_a_plan_too(tmp_path: Path, file_store: Store):
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"))
    (tmp_path / "mine/courier/go_to_goal.py").write_text("import no_such_library\ndef controller(environment): ...\n")
    for check in (check_own_bundles, lambda spec, base: resolve_references(spec, file_store, base)):
        with pytest.raises(DocumentError, match=r"go_to_goal.py, line 1: no library no_such_library is installed here"):
            check(spec, tmp_path)


def test_a_module_that_only_workers_elsewhere_import_is_let_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"))
    (tmp_path / "mine/courier/go_to_goal.py").write_text("import no_such_library\ndef controller(environment): ...\n")
    monkeypatch.setenv("SIMYARD_WORKERS", "dask:2")
    check_modules(spec, tmp_path)


def test_references_are_looked_up_in_a_store_that_is_named(tmp_path: Path, file_store: Store):
    (tmp_path / "document.json").write_text(
        _spec(tmp_path, _use("nobody", "courier", "go_to_goal")).model_dump_json(exclude_none=True)
    )
    command = ["validate", str(tmp_path / "document.json"), "--store", file_store.url]
    found = CliRunner().invoke(app, command)
    assert isinstance(found.exception, DocumentError)
    assert "worlds: 'g/w': not in the store" in str(found.exception)
    assert file_store.keys("") == ["store.json"]


def test_a_document_that_is_wrong_in_itself_is_told_with_what_is_wrong_in_its_bundles(tmp_path: Path):
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [_use("mine", "courier", "run.sh")]}
    robot = _use("mine", "courier", "go_to_goal")
    document = _spec(tmp_path, robot, deployment=deployment).model_dump(mode="json", exclude_none=True)
    (tmp_path / "mine/courier/run.sh").chmod(0o644)
    document["deployment"]["robots"] = 3  # which is left out to look at the rest
    document["no.section"] = 3
    document["simulationBatch"]["createSimulationJobRequests"][0]["maxJobDurationInSeconds"] = "long"  # the section is
    (tmp_path / "document.json").write_text(json.dumps(document))
    found = CliRunner().invoke(app, ["validate", str(tmp_path / "document.json")])
    assert isinstance(found.exception, DocumentError)
    assert [fault.path for fault in found.exception.faults] == [
        "simulationBatch.createSimulationJobRequests[0].maxJobDurationInSeconds",
        "deployment.robots",
        "no.section",
        "deployment.deploymentApplicationConfigs[0].launchConfig.launchFile",
    ]
    assert "chmod +x mine/courier/run.sh" in str(found.exception)


def test_what_is_there_is_not_refused(tmp_path: Path):
    check_launch_files(_spec(tmp_path, _use("mine", "courier", "go_to_goal")), tmp_path)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A machine on which nothing shuts applications in, and a process that holds keys."""
    monkeypatch.setattr(confinement, "confinement", lambda: confinement.Confinement("process", "as told"))
    monkeypatch.setenv("SIMYARD_KEYS", "keys")
    return monkeypatch


UNCONFINED = (
    r"simulationBatch: 'mine': an application that .* is shut in: nothing .* \(as told\), .* has the keys .*install"
)


def test_an_own_bundle_that_nothing_shuts_in_is_refused_by_who_holds_keys_before_anything_runs(
    tmp_path: Path, bare: pytest.MonkeyPatch
):
    """On 1b6713fb it ran; later the worlds were made before its process was refused."""
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"))
    check_confinement(spec, tmp_path)  # the folder holds what the courier that comes with Simyard does
    (tmp_path / "mine/note.txt").write_text("mine")
    with pytest.raises(DocumentError, match=UNCONFINED):
        check_own_bundles(spec, tmp_path)
    bare.setenv("SIMYARD_WORKERS", "tcp://there:8786")  # whose machines are asked when it comes to that
    check_confinement(spec, tmp_path)


def test_what_only_the_store_knows_is_listed_once(tmp_path: Path):
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [_use("tuger", "courier", "run.sh")]}
    spec = _spec(tmp_path, _use("tuger", "courier", "x"), deployment=deployment)
    assert unchecked_references(spec) == ["robot application tuger", "fleet team"]


def _ros_package(folder: Path, *files: str) -> None:
    """Makes a bundle called mine that has a ROS package patrol with these files, all empty."""
    for name in ("patrol/package.xml", *files):
        path = folder / "mine" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")


@pytest.mark.parametrize(
    ("package", "place"),
    [
        ("patrol", "patrol/launch/go.launch"),
        ("patrol", "patrol/go.launch"),
        ("scout", "ws/src/scout/launch/more/go.launch"),
    ],
)
def test_a_launch_file_of_ros_may_lie_where_roslaunch_finds_it(tmp_path: Path, package: str, place: str):
    _ros_package(tmp_path, place, "robot.xml", "ws/src/scout/package.xml")
    check_launch_files(_spec(tmp_path, _use("mine", package, "go.launch")), tmp_path)


def test_a_launch_file_that_a_ros_package_does_not_have_is_refused_with_the_places_where_it_was_looked_for(
    tmp_path: Path,
):
    _ros_package(tmp_path, "patrol/launch/go.launch", "robot.xml")
    looked = r"it has no patrol/launch/went.launch or patrol/went.launch, nor went.launch elsewhere in patrol"
    looked += r", nor patrol/went.py: name one that it has: patrol/launch/go.launch"
    with pytest.raises(DocumentError, match=looked):
        check_launch_files(_spec(tmp_path, _use("mine", "patrol", "went.launch")), tmp_path)


def test_a_ros_package_without_a_robot_is_refused_with_the_robot_that_may_be_copied(tmp_path: Path):
    _ros_package(tmp_path, "patrol/launch/go.launch")
    with pytest.raises(DocumentError, match=r"packageName: 'patrol': .*examples/ros/turtlebot3/robot.xml") as refused:
        check_launch_files(_spec(tmp_path, _use("mine", "patrol", "go.launch")), tmp_path)
    assert len(refused.value.faults) == 1


def test_a_document_from_before_that_says_launch_for_a_module_is_not_refused(tmp_path: Path):
    check_launch_files(_spec(tmp_path, _use("mine", "courier", "go_to_goal.launch")), tmp_path)


def test_a_deployment_may_launch_what_episodes_are_driven_with(tmp_path: Path):
    _ros_package(tmp_path, "patrol/launch/go.launch", "robot.xml")
    use = _use("mine", "patrol", "go.launch")
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [use]}
    check_launch_files(_spec(tmp_path, use, deployment=deployment), tmp_path)


@pytest.mark.parametrize("alone", [False, True])
def test_a_launch_file_of_ros_may_judge_and_brings_the_robot_if_it_is_alone(tmp_path: Path, *, alone: bool):
    _ros_package(tmp_path, "patrol/launch/go.launch")
    spec = _judged_spec(tmp_path, "go.launch", alone=alone)
    if not alone:
        check_launch_files(spec, tmp_path)
        return
    with pytest.raises(DocumentError, match=r"simulationApplications\[0\].launchConfig.packageName.*robot.xml"):
        check_launch_files(spec, tmp_path)


def test_a_launch_file_that_a_simulation_application_does_not_have_is_refused(tmp_path: Path):
    _ros_package(tmp_path, "patrol/launch/go.launch", "robot.xml")
    with pytest.raises(
        DocumentError, match=r"a launch file or a module in judge's bundle; it has no patrol/launch/no.launch"
    ):
        check_launch_files(_judged_spec(tmp_path, "no.launch"), tmp_path)


def _judged_spec(tmp_path: Path, launch_file: str, *, alone: bool = False) -> PipelineSpec:
    """Returns a document whose simulation application is the package's bundle."""
    spec = _spec(tmp_path, _use("courier", "courier", "go_to_goal"))
    document = spec.model_dump(mode="json", exclude_none=True)
    document["applications"].append({"name": "judge", "kind": "simulation", "source": "mine"})
    request = document["simulationBatch"]["createSimulationJobRequests"][0]
    request["simulationApplications"] = [_use("judge", "patrol", launch_file)]
    if alone:
        del request["robotApplications"]
    return PipelineSpec.model_validate(document)


EXPLODES = '<mujoco><worldbody><replicate count="100000000"><site/></replicate></worldbody></mujoco>'


def _exploding_spec(folder: Path, robots: dict[str, str]) -> PipelineSpec:
    for name, text in robots.items():
        (folder / name).mkdir()
        (folder / name / "robot.xml").write_text(text)
    sources = [{"name": name, "source": name} for name in robots]
    world = {
        "template": "templates/two-rooms.json",
        "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
    }
    return PipelineSpec.model_validate({"name": "mine", "applications": sources, "worldGeneration": world})


def test_each_robot_that_is_refused_is_a_fault_of_its_application(tmp_path: Path):
    spec = _exploding_spec(
        tmp_path, {"one": EXPLODES, "two": "<mujoco/>", "three": '<mujoco><include file="/etc/passwd"/></mujoco>'}
    )

    with pytest.raises(DocumentError) as caught:
        check_robot_files(spec, tmp_path)

    assert [fault.path for fault in caught.value.faults] == [f"applications[{number}].source" for number in range(3)]
    for fault, why in zip(
        caught.value.faults, ("more than 5,000 elements", "bodies in the world: none", "`..`"), strict=True
    ):
        assert why in fault.allowed


def test_each_thing_that_takes_away_what_a_robot_is_judged_by_is_a_fault(tmp_path: Path):
    courier = (ROOT / "applications/courier/robot.xml").read_text()
    blind = courier.replace('timestep="0.005"/>', 'timestep="0.005" wind="1 0 0"><flag contact="disable"/></option>')

    with pytest.raises(DocumentError) as caught:
        check_robot_files(_exploding_spec(tmp_path, {"one": blind}), tmp_path)

    found = [fault.allowed.split(":")[1] for fault in caught.value.faults]
    assert found == [" option flag contact disable", " option wind 1 0 0"]


def test_a_run_or_a_plan_refuses_such_a_document(tmp_path: Path):
    spec = _exploding_spec(tmp_path, {"one": EXPLODES})

    with pytest.raises(DocumentError, match="more than 5,000 elements"):
        resolve_references(spec, open_store((tmp_path / "store").as_uri()), tmp_path)


def document(launch_file: str = "policy") -> PipelineSpec:
    config = {"packageName": "nav", "launchFile": launch_file}
    entry = {
        "maxJobDurationInSeconds": 10,
        "robotApplications": [{"application": "mine", "launchConfig": config}],
        "simulationApplications": [
            {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
        ],
    }
    world = {
        "template": "templates/two-rooms.json",
        "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
    }
    batch = {"createSimulationJobRequests": [entry]}
    sources = [{"name": "mine", "source": "mine"}]
    return PipelineSpec.model_validate(
        {"name": "d", "applications": sources, "worldGeneration": world, "simulationBatch": batch}
    )


@pytest.mark.parametrize("launch_file", ["policy", "policy.onnx"])
def test_a_policy_that_fits_passes(tmp_path: Path, launch_file: str):
    bundle(tmp_path / "mine", network(weights()))
    check_policies(document(launch_file), tmp_path)


def test_a_policy_that_does_not_fit_is_a_fault_of_its_launch_file(tmp_path: Path):
    bundle(tmp_path / "mine", network(weights()), DECLARED.replace("rays: 8", "rays: 9"))
    with pytest.raises(DocumentError) as caught:
        check_policies(document(), tmp_path)
    (fault,) = caught.value.faults
    assert fault.path.endswith("robotApplications[0].launchConfig.launchFile")
    assert "observation of shape (lanes, 10): its parts are 11 numbers a lane" in fault.allowed


def test_a_module_is_no_policy(tmp_path: Path):
    (bundle(tmp_path / "mine", b"no network") / "nav/policy.py").write_text("")
    check_policies(document(), tmp_path)


WAITS = 'class Patrol:\n    def metrics(self, state):\n        return {"waiting_s": state.waiting_s}\n'
COMPUTES = "class Patrol:\n    def metrics(self, state):\n        return measure(state)\n"


def patrolled(folder: Path, source: str, *columns: str, scenario: str = "patrol") -> PipelineSpec:
    """Returns a document that brings a scenario along, with a rule about each column."""
    (folder / "patrol/patrol").mkdir(parents=True)
    (folder / "patrol/patrol/rounds.py").write_text(f"{source}def scenario(environment): ...\n")
    package = {"patrol": "patrol", "coverage": "coverage"}[scenario]
    launch = {"packageName": package, "launchFile": {"patrol": "rounds", "coverage": "floor"}[scenario]}
    job = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [
            {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "go_to_goal"}}
        ],
        "simulationApplications": [{"application": scenario, "launchConfig": launch}],
    }
    template = str(ROOT / "examples/templates/two-rooms.json")
    return PipelineSpec.model_validate(
        {
            "name": "patrols",
            "applications": [{"name": "patrol", "kind": "simulation", "source": "patrol"}],
            "worldGeneration": {"template": template, "worldCount": {"floorplanCount": 1}},
            "simulationBatch": {"createSimulationJobRequests": [job]},
            "gate": {"quantiles": [{"column": each, "quantile": 0.9, "atMost": 30} for each in columns]},
        }
    )


def test_validate_names_each_rule_the_name_and_what_was_meant(tmp_path: Path):
    spec = patrolled(tmp_path, WAITS, "metrics.waiting_s", "metrics.wating_s", "metrics.speed", "simulated_s")
    with pytest.raises(DocumentError) as caught:
        check_own_bundles(spec, tmp_path)
    first, second = caught.value.faults
    assert (first.path, first.value) == ("gate.quantiles[1].column", '"metrics.wating_s"')
    assert first.allowed == 'did you mean "metrics.waiting_s"? the scenario measures metrics.waiting_s'
    assert second.path == "gate.quantiles[2].column"


def test_validate_refuses_no_name_where_names_are_computed(tmp_path: Path):
    check_own_bundles(patrolled(tmp_path, COMPUTES, "metrics.anything"), tmp_path)


def test_validate_leaves_scenarios_of_the_store_to_plan(tmp_path: Path):
    check_own_bundles(patrolled(tmp_path, WAITS, "metrics.anything", scenario="coverage"), tmp_path)


def test_validate_leaves_a_scenario_that_nothing_can_be_called_to_plan(tmp_path: Path):
    document = patrolled(tmp_path, WAITS, "metrics.anything").model_dump(mode="json", exclude_none=True)
    document["simulationBatch"]["createSimulationJobRequests"][0]["simulationApplications"][0]["application"] = (
        "arn:x:y"
    )
    check_own_bundles(PipelineSpec.model_validate(document), tmp_path)


def test_a_plan_or_a_run_refuses_names_of_any_scenario(file_store: Store, tmp_path: Path):
    spec = patrolled(tmp_path, WAITS, "metrics.coverd_share", scenario="coverage")
    with pytest.raises(DocumentError, match=r'did you mean "metrics.covered_share"\?'):
        resolve_references(spec, file_store, tmp_path)


def test_robots_and_names_are_refused_together(tmp_path: Path):
    spec = patrolled(tmp_path, WAITS, "metrics.speed")
    (tmp_path / "one").mkdir()
    (tmp_path / "one/robot.xml").write_text(EXPLODES)
    robot = type(spec.applications[0])(name="one", source="one")
    both = spec.model_copy(update={"applications": (*spec.applications, robot)})
    with pytest.raises(DocumentError) as caught:
        check_own_bundles(both, tmp_path)
    assert [fault.path for fault in caught.value.faults] == ["applications[1].source", "gate.quantiles[0].column"]
