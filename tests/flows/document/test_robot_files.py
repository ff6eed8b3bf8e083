"""A robot that MuJoCo is not given is a fault of the document that brings it along."""

from pathlib import Path

import pytest

from flows.pipeline.bundle_checks import check_robot_files
from flows.pipeline.references import resolve_references
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.storage.store_url import open_store

EXPLODES = '<mujoco><worldbody><replicate count="100000000"><site/></replicate></worldbody></mujoco>'


def _spec(folder: Path, robots: dict[str, str]) -> PipelineSpec:
    for name, text in robots.items():
        (folder / name).mkdir()
        (folder / name / "robot.xml").write_text(text)
    sources = [{"name": name, "source": name} for name in robots]
    world = {
        "template": "templates/two-rooms.json",
        "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
    }
    return PipelineSpec.model_validate({"name": "mine", "applications": sources, "worldGeneration": world})


def test_each_robot_that_explodes_is_a_fault_of_its_application(tmp_path: Path):
    spec = _spec(
        tmp_path, {"one": EXPLODES, "two": "<mujoco/>", "three": '<mujoco><include file="/etc/passwd"/></mujoco>'}
    )

    with pytest.raises(DocumentError) as caught:
        check_robot_files(spec, tmp_path)

    assert [fault.path for fault in caught.value.faults] == ["applications[0].source", "applications[2].source"]
    assert "more than 5,000 elements" in caught.value.faults[0].allowed


def test_a_run_or_a_plan_refuses_such_a_document(tmp_path: Path):
    spec = _spec(tmp_path, {"one": EXPLODES})

    with pytest.raises(DocumentError, match="more than 5,000 elements"):
        resolve_references(spec, open_store((tmp_path / "store").as_uri()), tmp_path)
