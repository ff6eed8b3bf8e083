"""A policy that cannot be run as it is declared is a fault of the document that brings it along."""

from pathlib import Path

import pytest

from flows.pipeline.bundle_checks import check_policies
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tests.factories.policies import DECLARED, bundle, network, weights


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
