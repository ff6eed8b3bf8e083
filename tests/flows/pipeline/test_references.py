"""What a document refers to: found before anything runs, and the same thing in every stage."""

import re
import shutil
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from flows.pipeline import references
from flows.pipeline.references import deployed_version, finder, new_bucket_lines, numbered_finder, resolve_references
from flows.pipeline.tested_batch import batch_plan, tested_bundles
from flows.preview.plan import plan_lines
from specs.base import canonical_document, canonical_json
from specs.errors import BucketNotFound, DocumentError, ResourceNotFound
from specs.pipeline.document import PipelineSpec
from specs.robomaker.applications import SourceConfig
from specs.robomaker.bundle import ApplicationKind, Version
from tasks.applications.bucket_sources import create_application, create_version
from tasks.applications.registry import applications, pack, publish_bundle, resolve
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.results.gate.shipped_builds import Shipment, check_variables
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import output_location
from tasks.simulate.sandbox import confinement
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.keys import bundle_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.worlds import apartment
from tests.repository import ROOT

ROBOT = "robot-application"


def _put_world(store: Store, name: str) -> str:
    world = apartment(generation="hand", name=name)
    store.create(world_key(world.generation, world.name), canonical_json(canonical_document(world)))
    return f"hand/{name}"


def _launch(package: str, file: str, application: str, **more: object) -> dict[str, Any]:
    return {"application": application, "launchConfig": {"packageName": package, "launchFile": file}, **more}


def _request(robot: str = "courier", **scenario: object) -> dict[str, Any]:
    return {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [_launch("courier", "go_to_goal", robot)],
        "simulationApplications": [_launch("delivery", "rooms", "delivery", **scenario)],
    }


def _spec(**sections: object) -> PipelineSpec:
    return PipelineSpec.model_validate({"name": "resolved", **sections})


def _generated(*requests: dict[str, Any], **sections: object) -> PipelineSpec:
    generation = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}}
    return _spec(worldGeneration=generation, simulationBatch={"createSimulationJobRequests": requests}, **sections)


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """Returns a copy of the courier that may be changed."""
    shutil.copytree(ROOT / "applications/courier", tmp_path / "mine")
    return tmp_path / "mine"


def _with_own(bundle: Path, **sections: object) -> PipelineSpec:
    source = {"name": "mine", "source": bundle.name}
    return _generated(_request("mine"), applications=[source], **sections)


def _deployment(application: str, **more: object) -> dict[str, Any]:
    return {
        "fleet": {"name": "team", "localAgents": 1},
        "deploymentApplicationConfigs": [_launch("courier", "run.sh", application, **more)],
    }


def test_a_bundle_that_was_changed_back_is_what_is_tested_and_shipped(file_store: Store, bundle: Path):
    spec = _with_own(bundle, deployment=_deployment("mine"))
    shutil.copytree(ROOT / "examples/templates", bundle.parent / "templates")
    before = publish_bundle(file_store, ROBOT, "mine", bundle)
    (bundle / "note.txt").write_text("changed")
    publish_bundle(file_store, ROBOT, "mine", bundle)
    (bundle / "note.txt").unlink()
    found = resolve_references(spec, file_store, bundle.parent)
    assert found.bundled[f"{ROBOT}/mine"] == before
    assert found.pins()["deployment"] == before.digest
    find = numbered_finder(file_store, {f"{ROBOT}/mine": str(before.number)})
    assert spec.simulationBatch is not None
    assert tested_bundles(batch_plan(spec.simulationBatch, (), file_store, find), "") == {"mine": before.digest}


def test_a_plan_publishes_nothing(file_store: Store, bundle: Path):
    shutil.copytree(ROOT / "examples/templates", bundle.parent / "templates")
    lines = list(plan_lines(_with_own(bundle, deployment=_deployment("mine")), bundle.parent, file_store))
    assert any("deployment" in line for line in lines)
    assert applications(file_store, ROBOT) == []
    assert file_store.keys("bundles") == []


def test_a_request_with_its_own_world_keeps_it_to_itself(file_store: Store):
    mine, theirs = _put_world(file_store, "a"), _put_world(file_store, "b")
    batch = {
        "matrix": {"worlds": [mine]},
        "createSimulationJobRequests": [_request(), _request(worldConfigs=[{"world": theirs}])],
    }
    spec = _spec(simulationBatch=batch)
    assert spec.simulationBatch is not None
    plan = batch_plan(spec.simulationBatch, (), file_store, finder(file_store, {}))
    assert [request.world for request in Layout(plan).requests()] == [mine, theirs]
    assert set(plan.world_digests) == {mine, theirs}


def test_applications_that_nothing_shuts_in_are_refused_by_who_holds_keys_before_anything_runs(
    file_store: Store, bundle: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(confinement, "confinement", lambda: confinement.Confinement("process", "as told"))
    monkeypatch.setenv("SIMYARD_KEYS", "keys")
    shutil.copytree(ROOT / "examples/templates", bundle.parent / "templates")
    resolve_references(_with_own(bundle), file_store, bundle.parent)
    (bundle / "note.txt").write_text("changed")
    publish_bundle(file_store, ROBOT, "theirs", bundle)
    for spec in (_with_own(bundle), _generated(_request("theirs"))):
        with pytest.raises(DocumentError, match=r"simulationBatch: '\w+': an application that .*\(SIMYARD_KEYS\)"):
            resolve_references(spec, file_store, bundle.parent)


def test_a_bundle_that_no_batch_tests_is_not_shipped(file_store: Store, bundle: Path):
    publish_bundle(file_store, ROBOT, "other", bundle)
    (bundle / "note.txt").write_text("another bundle")
    publish_bundle(file_store, ROBOT, "other", bundle)
    spec = _generated(_request(), deployment=_deployment("other"))
    with pytest.raises(DocumentError, match=r"other version 2 .* the bundle that simulationBatch tests; .*: courier"):
        resolve_references(spec, file_store, ROOT / "examples")


@pytest.mark.parametrize("named", [{}, {"applicationVersion": "2"}])
def test_the_version_that_the_gate_compares_with_is_tested_and_not_shipped(
    file_store: Store, bundle: Path, named: dict[str, str]
):
    publish_bundle(file_store, ROBOT, "mine", bundle)
    (bundle / "note.txt").write_text("newer")
    newer = publish_bundle(file_store, ROBOT, "mine", bundle)
    requests = [_request("mine"), _request("mine")]
    for request, version in zip(requests, ("2", "1"), strict=True):
        request["robotApplications"][0]["applicationVersion"] = version
    gate = {"noWorseThan": {"applicationVersion": "1", "margin": 0.02}}
    spec = _generated(*requests, gate=gate, deployment=_deployment("mine", **named))
    shutil.copytree(ROOT / "examples/templates", bundle.parent / "templates")
    found = resolve_references(spec, file_store, bundle.parent)
    assert found.pins()["deployment"] == newer.digest


@pytest.mark.parametrize(
    ("gate", "refused"),
    [
        (None, False),
        ({"successRate": {"atLeast": 0.9}}, True),
        ({"noWorseThan": {"applicationVersion": "3", "margin": 0.02}}, True),
        ({"noWorseThan": {"applicationVersion": "1", "margin": 0.02}, "successRate": {"atLeast": 0.9}}, False),
    ],
)
def test_a_gate_that_would_count_two_versions_together_is_refused(
    file_store: Store,
    bundle: Path,
    gate: dict[str, Any] | None,
    refused: bool,  # noqa: FBT001 - a case
):
    for number in range(3):
        (bundle / "note.txt").write_text(str(number))
        publish_bundle(file_store, ROBOT, "mine", bundle)
    requests = [_request("mine"), _request("mine")]
    for request, version in zip(requests, ("1", "2"), strict=True):
        request["robotApplications"][0]["applicationVersion"] = version
    spec = _generated(*requests, **({"gate": gate} if gate else {}))
    said = r"gate: mine version 1, mine version 2: a batch that tests one version"
    with pytest.raises(DocumentError, match=said) if refused else nullcontext():
        resolve_references(spec, file_store, ROOT / "examples")


def test_a_version_to_compare_with_that_does_not_exist_is_told_before_anything_runs(file_store: Store):
    spec = _generated(_request(), gate={"noWorseThan": {"applicationVersion": "7", "margin": 0.02}})
    with pytest.raises(DocumentError, match=r"gate\.noWorseThan\.applicationVersion: '?7'?: a version of courier: 1"):
        resolve_references(spec, file_store, ROOT / "examples")


def test_the_tested_version_is_shipped_when_the_deployment_names_none(file_store: Store, bundle: Path):
    old = publish_bundle(file_store, ROBOT, "mine", bundle)
    (bundle / "note.txt").write_text("newer")
    publish_bundle(file_store, ROBOT, "mine", bundle)
    spec = _spec(deployment=_deployment("mine"))
    assert spec.deployment is not None
    find = finder(file_store, {})
    assert deployed_version(spec.deployment, file_store, find, {"mine": old.digest}) == old
    assert deployed_version(spec.deployment, file_store, find, None).number == 2


def test_all_that_is_missing_is_told_at_once(file_store: Store):
    spec = _spec(
        worldGeneration={"template": "nowhere", "worldCount": {"floorplanCount": 1}},
        worldExport={"worlds": ["none/none"], "outputLocation": {"s3Bucket": "out"}},
        simulationBatch={"createSimulationJobRequests": [_request("nobody")]},
    )
    with pytest.raises(DocumentError) as refused:
        resolve_references(spec, file_store, ROOT / "examples")
    told = [fault.value for fault in refused.value.faults]
    assert told == ["'nowhere'", "'none/none'", "'nobody'"]


def test_a_version_that_a_search_is_against_has_to_be_there(file_store: Store):
    publish_bundle(file_store, ROBOT, "mine", ROOT / "applications/courier")
    spec = _generated(_request("mine"), search={"over": {}, "against": "7"})
    with pytest.raises(ResourceNotFound) as refused:
        resolve_references(spec, file_store, ROOT / "examples")
    assert [fault.path for fault in refused.value.faults] == ["search.against"]


def test_every_world_and_application_that_a_batch_lacks_is_told_at_once(file_store: Store):
    one, other = _request("nobody"), _request("nobody", worldConfigs=[{"world": "g/own"}])
    other["simulationApplications"][0]["application"] = "noplace"
    batch = {"matrix": {"worlds": ["g/w1", "g/w2"]}, "createSimulationJobRequests": [one, other]}
    with pytest.raises(ResourceNotFound) as refused:
        resolve_references(_spec(simulationBatch=batch), file_store, ROOT / "examples")
    told = [fault.value for fault in refused.value.faults]
    assert told == ["'g/w1'", "'g/w2'", "'g/own'", "'nobody'", "'noplace'"], "each once, as often as it is launched"


def test_tables_go_where_the_requests_agree(file_store: Store):
    here, there = {"s3Bucket": "mybucket", "s3Prefix": "x"}, {"s3Bucket": "other"}
    agreed = _generated({**_request(), "outputLocation": here}, _request()).simulationBatch
    torn = _generated({**_request(), "outputLocation": here}, {**_request(), "outputLocation": there}).simulationBatch
    assert agreed is not None
    assert torn is not None
    assert output_location(agreed).s3Bucket == "mybucket"
    with pytest.raises(DocumentError, match="mybucket/x, other/"):
        output_location(torn)


def test_a_world_that_is_not_there_is_a_fault_of_the_document(file_store: Store):
    spec = _spec(simulationBatch={"matrix": {"worlds": ["g/w"]}, "createSimulationJobRequests": [_request()]})
    assert spec.simulationBatch is not None
    with pytest.raises(ResourceNotFound, match="g/w"):
        batch_plan(spec.simulationBatch, (), file_store, finder(file_store, {}))


def test_a_launch_file_that_no_bundle_holds_is_told_before_anything_runs(file_store: Store):
    request = _request()
    request["robotApplications"][0]["launchConfig"]["launchFile"] = "go_to_gaol"
    with pytest.raises(DocumentError, match=r"'go_to_gaol'.*courier/go_to_gaol"):
        resolve_references(_generated(request), file_store, ROOT / "examples")
    deployment = _deployment("courier")
    deployment["deploymentApplicationConfigs"][0]["launchConfig"]["launchFile"] = "nope.sh"
    with pytest.raises(DocumentError, match=r"nope\.sh"):
        resolve_references(_generated(_request(), deployment=deployment), file_store, ROOT / "examples")


def test_a_fleet_that_nobody_made_is_told_before_anything_runs(file_store: Store):
    deployment = {**_deployment("courier"), "fleet": "strangers"}
    with pytest.raises(DocumentError, match=r"deployment\.fleet.*strangers"):
        resolve_references(_generated(_request(), deployment=deployment), file_store, ROOT / "examples")


def test_robots_elsewhere_need_keys_or_a_word_that_there_are_none(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_KEYS", raising=False)
    create_fleet(file_store, "strangers")
    register_robot(file_store, "strangers", create_robot(file_store, "r1").name)
    deployment = {**_deployment("courier"), "fleet": "strangers"}
    with pytest.raises(DocumentError, match=r"deployment\.trust.*simyard fleet keys init.*or trust: unsigned"):
        resolve_references(_generated(_request(), deployment=deployment), file_store, ROOT / "examples")
    unsigned = {**deployment, "trust": "unsigned"}
    resolve_references(_generated(_request(), deployment=unsigned), file_store, ROOT / "examples")


def test_a_missing_application_is_told_with_its_place_in_the_document(file_store: Store):
    place = r"createSimulationJobRequests\[1\]\.robotApplications\[0\]\.application"
    with pytest.raises(DocumentError, match=place):
        resolve_references(_generated(_request(), _request("nobody")), file_store, ROOT / "examples")


def test_a_thousand_requests_look_up_each_application_once(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    asked: list[str] = []

    def counted(store: Store, kind: ApplicationKind, reference: str, version: str | None = None) -> Version:
        asked.append(reference)
        return resolve(store, kind, reference, version)

    monkeypatch.setattr(references, "resolve", counted)
    world = _put_world(file_store, "apartment")
    requests = [_request(worldConfigs=[{"world": world}]) for _ in range(1000)]
    section = _spec(simulationBatch={"createSimulationJobRequests": requests}).simulationBatch
    assert section
    plan = batch_plan(section, (), file_store, finder(file_store, {}))
    assert (len(plan.templates), Layout(plan).chunks) == (1000, 4)
    assert asked == ["courier", "delivery"]


def test_a_format_that_cannot_be_written_here_is_refused_before_anything_runs(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("tasks.export.format.formats.find_spec", lambda _: None)
    world = _put_world(file_store, "world-1-1")
    export = {"worlds": [world], "formats": ["usd", "svg", "glb"], "outputLocation": {"s3Bucket": "worlds"}}
    with pytest.raises(DocumentError) as caught:
        resolve_references(_spec(worldExport=export), file_store, tmp_path)
    assert [(fault.path, fault.value) for fault in caught.value.faults] == [
        ("worldExport.formats", "glb"),
        ("worldExport.formats", "usd"),
    ]


def test_a_version_whose_source_was_changed_is_not_used(file_store: Store, bundle: Path) -> None:
    bucket = open_bucket(file_store, "builds")
    bucket.put("a.tar", pack(bundle))
    create_application(file_store, ROBOT, "mine", [SourceConfig(s3Bucket="builds", s3Key="a.tar")])
    version = create_version(file_store, ROBOT, "mine")
    assert finder(file_store, {})(ROBOT, "mine", None) == version
    (bundle / "more").write_text("more")
    bucket.put("a.tar", pack(bundle))

    with pytest.raises(DocumentError, match="RobotApplicationVersionMismatchedEtag"):
        finder(file_store, {})(ROBOT, "mine", "1")


def test_what_has_no_build_for_x86_is_not_simulated(file_store: Store, bundle: Path) -> None:
    publish_bundle(file_store, ROBOT, "mine", {"ARM64": bundle})
    section = _generated(_request("mine")).simulationBatch
    assert section is not None

    with pytest.raises(DocumentError, match=r"mine version 1, for ARM64: a version with an X86_64 source"):
        batch_plan(section, (), file_store, finder(file_store, {}))


@pytest.mark.parametrize("spoil", ["removed", "changed"])
def test_a_version_whose_bundle_is_gone_or_changed_is_refused_with_robomakers_code(
    file_store: Store, bundle: Path, spoil: str
):
    version = publish_bundle(file_store, ROBOT, "mine", bundle)
    key = bundle_key(version.digest)
    if spoil == "removed":
        file_store.delete(key)
    else:
        file_store.put(key, file_store.get(key).body.replace(b"def ", b"fed "))

    shutil.copytree(ROOT / "examples/templates", bundle.parent / "templates")

    with pytest.raises(DocumentError) as refused:
        resolve_references(_generated(_request("mine")), file_store, bundle.parent)

    (fault,) = refused.value.faults
    assert (fault.path.rpartition(".")[2], fault.value) == ("robotApplications", "mine version 1")
    assert "InvalidBundleRobotApplication: the bundle of mine version 1" in fault.allowed
    assert "simyard app publish mine FOLDER" in fault.allowed


def test_a_missing_output_bucket_hides_no_other_fault(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    def missing(_store: Store, bucket: str) -> Store:
        raise BucketNotFound(f"bucket {bucket}: there is none")

    monkeypatch.setattr(references, "open_bucket", missing)
    export = {"outputLocation": {"s3Bucket": "nowhere"}, "formats": ["svg"]}
    with pytest.raises(DocumentError) as refused:
        resolve_references(_generated(_request("nobody"), worldExport=export), file_store, ROOT / "examples")
    paths = [fault.path for fault in refused.value.faults]
    assert "worldExport.outputLocation.s3Bucket" in paths
    assert len(paths) > 1


def _exporting_spec(batch: str, export: str) -> PipelineSpec:
    return PipelineSpec.model_validate(
        {
            "name": "n",
            "worldExport": {"worlds": ["g/w"], "outputLocation": {"s3Bucket": export}},
            "simulationBatch": {
                "matrix": {"worlds": ["g/w"]},
                "outputLocation": {"s3Bucket": batch},
                "createSimulationJobRequests": [{"maxJobDurationInSeconds": 60}],
            },
        }
    )


def test_a_bucket_that_is_not_there_is_named_once_with_those_that_are(file_store: Store):
    for name in ("results", "worlds"):
        open_bucket(file_store, name).put("a", b"")

    (line,) = new_bucket_lines(_exporting_spec("reslts", "reslts"), file_store)

    folder = f"{file_store.url.removeprefix('file://')}/buckets/reslts"
    assert line == f"bucket reslts is new, and is made in {folder}; there are results, worlds"
    assert not open_bucket(file_store, "reslts").keys("")


def test_the_first_bucket_of_a_store_is_new_and_one_that_is_there_is_not(file_store: Store):
    (line,) = new_bucket_lines(_exporting_spec("results", "results"), file_store)
    assert line.endswith("/buckets/results")
    open_bucket(file_store, "results").put("a", b"")
    assert [*new_bucket_lines(_exporting_spec("results", "results"), file_store)] == []


def test_of_a_server_nothing_is_said_because_it_refuses_what_it_does_not_have(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_BUCKETS", "s3://")
    assert [*new_bucket_lines(_exporting_spec("results", "results"), file_store)] == []


BASE = ROOT / "examples"
VARIABLES = "launchConfig.environmentVariables"


@pytest.fixture
def builds(file_store: Store, tmp_path: Path) -> dict[str, str]:
    """A version of the courier with another bundle for ARM64; the digest of each."""
    folders = {name: tmp_path / name for name in ("X86_64", "ARM64")}
    for name, folder in folders.items():
        shutil.copytree(ROOT / "applications/courier", folder, ignore=shutil.ignore_patterns("__pycache__"))
        (folder / "built-for").write_text(name)
    by_architecture: Any = folders
    return {**publish_bundle(file_store, "robot-application", "mine", by_architecture).digests}


def _driven_request(
    architecture: str | None = None, scenarios: dict[str, str] | None = None, **variables: str
) -> dict[str, Any]:
    own: dict[str, Any] = {"architecture": architecture} if architecture else {}
    launch = {"packageName": "courier", "launchFile": "go_to_goal", "environmentVariables": variables}
    scenario = {"packageName": "delivery", "launchFile": "rooms", "environmentVariables": scenarios or {}}
    return {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": "mine", **own, "launchConfig": launch}],
        "simulationApplications": [{"application": "delivery", "launchConfig": scenario}],
    }


def _document(
    *requests: dict[str, Any], variables: dict[str, str] | None = None, gated: bool = True, **deployment: object
) -> PipelineSpec:
    launch = {"packageName": "courier", "launchFile": "run.sh", "environmentVariables": variables or {}}
    return PipelineSpec.model_validate(
        {
            "name": "shipped",
            "worldGeneration": {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}},
            "simulationBatch": {"createSimulationJobRequests": requests or [_driven_request()]},
            "gate": {"successRate": {"atLeast": 0.5}} if gated else None,
            "deployment": {
                "fleet": {"name": "team", "localAgents": 1},
                "deploymentApplicationConfigs": [{"application": "mine", "launchConfig": launch}],
                **deployment,
            },
        }
    )


def _ships(spec: PipelineSpec, store: Store) -> Shipment:
    ships = resolve_references(spec, store, BASE).ships
    assert ships
    return ships


def _refused(spec: PipelineSpec, store: Store) -> list[str]:
    with pytest.raises(DocumentError) as caught:
        resolve_references(spec, store, BASE)
    return [fault.path for fault in caught.value.faults]


def test_a_build_that_no_request_drives_is_refused_before_anything_runs(file_store: Store, builds: dict[str, str]):
    assert builds["X86_64"] != builds["ARM64"]
    assert _refused(_document(), file_store) == ["deployment.untestedBuilds"]


def test_a_request_of_its_own_drives_a_build(file_store: Store, builds: dict[str, str]):
    ships = _ships(_document(_driven_request(), _driven_request("ARM64")), file_store)
    assert ships.digest == builds["X86_64"]
    assert [build.tested_as for build in ships.builds] == [None, None]


def test_a_build_that_is_named_with_what_stands_for_it_ships_and_is_told(file_store: Store, builds: dict[str, str]):
    named = {"ARM64": {"testedAs": "X86_64", "digest": builds["ARM64"]}}
    spec = _document(untestedBuilds=named)
    assert [build.tested_as for build in _ships(spec, file_store).builds] == [None, "X86_64"]
    told = "\n".join(plan_lines(spec, BASE, file_store))
    assert f"mine version 1 for X86_64, {builds['X86_64'][:12]}: simulated" in told
    stands = "NOT SIMULATED; the document says that the build for X86_64 stands for it"
    assert f"mine version 1 for ARM64, {builds['ARM64'][:12]}: {stands}" in told
    assert "robots launch courier/run.sh; episodes drive courier/go_to_goal" in told


def test_without_a_gate_all_ships_and_the_plan_names_what_no_episode_drives(file_store: Store, builds: dict[str, str]):
    spec = _document(gated=False, variables={"MAX_SPEED": "9"})
    assert _ships(spec, file_store).digests() == builds
    told = "\n".join(plan_lines(spec, BASE, file_store))
    assert f"mine version 1 for X86_64, {builds['X86_64'][:12]}: simulated\n" in told
    assert f"mine version 1 for ARM64, {builds['ARM64'][:12]}: not simulated, and no gate asks\n" in told
    assert "variable MAX_SPEED: not as simulated, and no gate asks\n" in told


def test_an_architecture_of_a_version_with_one_bundle_is_a_fault(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    (path,) = _refused(_document(_driven_request("ARM64")), file_store)
    assert path.endswith("createSimulationJobRequests[0].robotApplications[0].architecture")


def test_an_architecture_that_the_version_lacks_is_a_fault(file_store: Store, builds: dict[str, str]):
    assert "ARMHF" not in builds
    (path,) = _refused(_document(_driven_request("ARMHF")), file_store)
    assert path.endswith("robotApplications[0].architecture")


@pytest.mark.parametrize("given", [{"MAX_SPEED": "9"}, {}])
def test_a_variable_that_differs_is_refused_before_anything_runs(file_store: Store, given: dict[str, str]):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    spec = _document(_driven_request(MAX_SPEED="0.5"), variables=given)
    (path,) = _refused(spec, file_store)
    assert path.endswith(f"{VARIABLES}.MAX_SPEED")
    with pytest.raises(
        DocumentError, match=rf"{re.escape(path)}: .*: a value that simulationBatch drives: '0\.5'; or "
    ):
        check_variables(spec, BASE)  # for which no store is needed


def test_the_scenarios_variables_count_because_the_controller_gets_them(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    request = _driven_request(scenarios={"MAX_SPEED": "0.5"})
    check_variables(_document(request, variables={"MAX_SPEED": "0.5"}), BASE)
    (path,) = _refused(_document(request, variables={"MAX_SPEED": "9"}), file_store)
    assert path.endswith(f"{VARIABLES}.MAX_SPEED")
    assert _ships(_document(request, variables={"MAX_SPEED": "0.5"}), file_store).variables == {"MAX_SPEED": "0.5"}


def test_the_values_of_the_matrix_are_those_that_may_ship(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    spec = _document(variables={"MAX_SPEED": "0.6"})
    assert spec.simulationBatch
    matrix = spec.simulationBatch.matrix.model_copy(update={"environmentVariables": {"MAX_SPEED": ("0.4", "0.6")}})
    batch = spec.simulationBatch.model_copy(update={"matrix": matrix})
    swept = spec.model_copy(update={"simulationBatch": batch})
    assert _ships(swept, file_store).variables == {"MAX_SPEED": "0.6"}
    check_variables(swept, BASE)


def test_variables_of_builds_that_differ_in_their_own_are_left_to_the_store(file_store: Store, builds: dict[str, str]):
    given, named = {"A": "0", "B": "0"}, {"A": "slower on X86_64", "B": "slower on ARM64"}
    requests = (_driven_request(A="1", B="0"), _driven_request("ARM64", A="0", B="1"))
    spec = _document(*requests, variables=given, untestedVariables=named)
    assert _ships(spec, file_store).untested == named
    check_variables(spec, BASE)


def test_a_variable_that_is_named_ships_and_is_told_without_its_value(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    named = {"TOKEN": "the launch script sends heartbeats with it"}
    spec = _document(variables={"TOKEN": "s3cret"}, untestedVariables=named)
    assert _ships(spec, file_store).untested == named
    told = "\n".join(plan_lines(spec, BASE, file_store))
    assert "variable TOKEN: NOT AS SIMULATED; the document says why: the launch script sends heartbeats" in told
    assert "s3cret" not in told


def test_a_bundle_that_is_only_deployed_is_named_from_the_documents_folder_and_planned_as_not_simulated(
    file_store: Store, tmp_path: Path
):
    start = tmp_path / "robots/hauler/nav/start"
    start.parent.mkdir(parents=True)
    start.write_text("#!/bin/sh\nexec sleep 1000\n")
    launch = {"application": "hauler", "launchConfig": {"packageName": "nav", "launchFile": "start"}}
    deployment = {"fleet": {"name": "team", "localAgents": 1}, "deploymentApplicationConfigs": [launch]}
    own = [{"name": "hauler", "source": "robots/hauler"}]
    spec = PipelineSpec.model_validate({"name": "n", "applications": own, "deployment": deployment})
    with pytest.raises(DocumentError, match="start is not executable: chmod \\+x robots/hauler/nav/start"):
        resolve_references(spec, OverlayStore(file_store), tmp_path)
    start.chmod(0o755)
    told = list(plan_lines(spec, tmp_path, file_store))
    assert any("no episode of this document drives the version, and no gate asks" in line for line in told)


def test_folders_of_data_sources_are_no_variables_that_robots_could_get(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    request = {**_driven_request(), "dataSources": [{"name": "maps", "s3Bucket": "my-data", "s3Keys": ["maps/"]}]}
    assert _ships(_document(request), file_store).variables == {}
