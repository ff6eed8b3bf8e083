"""What a gated document ships is settled before anything runs: each build and each variable driven, or named."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from flows.pipeline.references import resolve_references
from flows.preview.plan import plan_lines
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.applications.registry import publish_bundle
from tasks.results.gate.shipped_builds import Shipment
from tasks.storage.base.store import Store
from tests.repository import ROOT

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


def _request(
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
            "simulationBatch": {"createSimulationJobRequests": requests or [_request()]},
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
    ships = _ships(_document(_request(), _request("ARM64")), file_store)
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
    (path,) = _refused(_document(_request("ARM64")), file_store)
    assert path.endswith("createSimulationJobRequests[0].robotApplications[0].architecture")


def test_an_architecture_that_the_version_lacks_is_a_fault(file_store: Store, builds: dict[str, str]):
    assert "ARMHF" not in builds
    (path,) = _refused(_document(_request("ARMHF")), file_store)
    assert path.endswith("robotApplications[0].architecture")


@pytest.mark.parametrize("given", [{"MAX_SPEED": "9"}, {}])
def test_a_variable_that_differs_is_refused_before_anything_runs(file_store: Store, given: dict[str, str]):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    (path,) = _refused(_document(_request(MAX_SPEED="0.5"), variables=given), file_store)
    assert path.endswith(f"{VARIABLES}.MAX_SPEED")


def test_the_scenarios_variables_count_because_the_controller_gets_them(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    request = _request(scenarios={"MAX_SPEED": "0.5"})
    (path,) = _refused(_document(request, variables={"MAX_SPEED": "9"}), file_store)
    assert path.endswith(f"{VARIABLES}.MAX_SPEED")
    assert _ships(_document(request, variables={"MAX_SPEED": "0.5"}), file_store).variables == {"MAX_SPEED": "0.5"}


def test_the_values_of_the_matrix_are_those_that_may_ship(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    spec = _document(variables={"MAX_SPEED": "0.6"})
    assert spec.simulationBatch
    matrix = spec.simulationBatch.matrix.model_copy(update={"environmentVariables": {"MAX_SPEED": ("0.4", "0.6")}})
    batch = spec.simulationBatch.model_copy(update={"matrix": matrix})
    assert _ships(spec.model_copy(update={"simulationBatch": batch}), file_store).variables == {"MAX_SPEED": "0.6"}


def test_a_variable_that_is_named_ships_and_is_told_without_its_value(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    named = {"TOKEN": "the launch script sends heartbeats with it"}
    spec = _document(variables={"TOKEN": "s3cret"}, untestedVariables=named)
    assert _ships(spec, file_store).untested == named
    told = "\n".join(plan_lines(spec, BASE, file_store))
    assert "variable TOKEN: NOT AS SIMULATED; the document says why: the launch script sends heartbeats" in told
    assert "s3cret" not in told


def test_folders_of_data_sources_are_no_variables_that_robots_could_get(file_store: Store):
    publish_bundle(file_store, "robot-application", "mine", ROOT / "applications/courier")
    request = {**_request(), "dataSources": [{"name": "maps", "s3Bucket": "my-data", "s3Keys": ["maps/"]}]}
    assert _ships(_document(request), file_store).variables == {}
