"""A document is a path, a text, a dictionary or what `validate` returned; all are the same document."""

import json
import shutil
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import yaml

import simyard
from specs.errors import DocumentError, PipelineNotPassed, StageFailed
from tasks.ros.launch.packages import RosInstallation
from tests.flows.pipeline.test_robot_drafts import judged_bundle
from tests.repository import ROOT
from tests.ros.conftest import ros

__all__ = ["ros"]

FILE = ROOT / "examples/worlds-only.yaml"
TEXT = FILE.read_text()
DATA = yaml.safe_load(TEXT)


def test_each_form_is_the_same_document(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)
    spec = simyard.validate(FILE)
    assert simyard.validate("examples/worlds-only.yaml") == spec
    for form in (TEXT, json.dumps(DATA), DATA, MappingProxyType(DATA), spec):
        assert simyard.validate(form, base="examples") == spec


def test_a_base_wins_over_the_folder_of_the_file(tmp_path: Path):
    shutil.copy(FILE, tmp_path)
    with pytest.raises(DocumentError, match=r"two-rooms\.json: there is no such file"):
        simyard.validate(tmp_path / FILE.name)
    assert simyard.validate(tmp_path / FILE.name, base=ROOT / "examples").name == "two-worlds"


def test_numbers_of_numpy_and_paths_are_data():
    section = {**DATA["worldGeneration"], "seed": np.int64(3), "template": ROOT / "examples/templates/two-rooms.json"}
    spec = simyard.validate({**DATA, "worldGeneration": section})
    assert spec.worldGeneration is not None
    assert spec.worldGeneration.seed == 3


def test_a_dictionary_that_holds_itself_is_refused():
    endless: dict[str, object] = {"name": "endless"}
    endless["worldGeneration"] = endless
    with pytest.raises(DocumentError, match="Circular reference"):
        simyard.validate(endless)


@pytest.mark.parametrize(
    ("document", "told"),
    [
        ({"name": "n", "worldGeneration": {1, 2}}, "document: set is no data of a document: texts, numbers"),
        ({"name": float("nan")}, "document: 1 fault\n  file: NaN"),
        ("name: n\nworldGeneration: &a {}\n", "document: 1 fault\n  line 2"),
        ("none.yaml", "none.yaml: 1 fault\n  file: there is no such file"),
        ({"name": "n"}, "at least one of applications"),
    ],
)
def test_what_is_no_document_is_told_with_where_it_was(document: object, told: str):
    with pytest.raises(DocumentError) as said:
        simyard.validate(document)  # pyright: ignore[reportArgumentType] - as a user may
    assert told in str(said.value)


def test_all_faults_are_told_at_once():
    with pytest.raises(DocumentError) as said:
        simyard.validate({"name": "two words", "nothing": 1, "worldGeneration": {"template": "none.json"}})
    assert len(said.value.faults) == 4


def test_a_plan_is_what_the_command_prints(tmp_path: Path):
    plan = simyard.plan(FILE, store=tmp_path / "store")
    assert str(plan).splitlines()[1] == plan.lines[1]
    assert plan.lines[1].startswith("worldGeneration   2 worlds")
    assert repr(plan) == f"<Plan 'two-worlds': {len(plan.lines)} lines; print() shows them>"
    assert "worldGeneration   2 worlds" in plan._repr_html_()


def test_a_plan_names_the_document_in_its_faults(tmp_path: Path):
    document = {"name": "n", "worldExport": {"worlds": ["g/none"], "outputLocation": {"s3Bucket": "b"}}}
    with pytest.raises(DocumentError, match=r"^document: 1 fault"):
        simyard.plan(document, store=tmp_path / "store")


@pytest.mark.integration
@pytest.mark.long
def test_a_run_returns_what_came_of_it_and_tells_how_far_it_is(tmp_path: Path):
    told: list[tuple[str, int, int]] = []
    run = simyard.run(FILE, store=tmp_path / "s", direct=True, progress=lambda *each: told.append(each))
    assert run.passed
    assert run.verdict is run.shipped is run.batch is None
    assert run.store == (tmp_path / "s").as_uri()
    assert repr(run) == f"<Run 'two-worlds' {run.id}: passed>"
    assert ("Worlds", 2, 2) in told
    assert run.require_passed() is run
    assert simyard.run(FILE, store=tmp_path / "s", direct=True).id != run.id
    assert [each.name for each in simyard.worlds(run)] == [each.name for each in simyard.worlds(store=tmp_path / "s")][
        :2
    ]


@pytest.mark.integration
@pytest.mark.long
def test_a_gate_that_does_not_pass_is_an_answer_and_no_exception(tmp_path: Path):
    document = yaml.safe_load((ROOT / "examples/quickstart.yaml").read_text())
    document["worldGeneration"]["worldCount"] = {"floorplanCount": 1}
    document["simulationBatch"]["matrix"] = {"worlds": "all", "seeds": 2}
    del document["worldExport"], document["deployment"]
    document["gate"] = {"successRate": {"atLeast": 0.9}}
    run = simyard.run(document, base=ROOT / "examples", store=tmp_path / "s", direct=True)
    assert (run.passed, run.verdict) == (False, "INCONCLUSIVE")
    assert "INCONCLUSIVE" in run._repr_html_()
    with pytest.raises(PipelineNotPassed, match="the gate says INCONCLUSIVE"):
        run.require_passed()
    assert len(simyard.results(run)) == 2
    assert simyard.replay(run, 1).same


@pytest.mark.integration
@pytest.mark.long
def test_a_simulation_application_judges_its_job_for_python_too(ros: RosInstallation, tmp_path: Path):
    judged_bundle(tmp_path / "judge")
    launch = {"packageName": "rover_sim", "launchFile": "judged.launch", "environmentVariables": {"SPEED": "0.4"}}
    request = {
        "maxJobDurationInSeconds": 10,
        "simulationApplications": [{"application": "judge", "launchConfig": launch}],
    }
    document = {
        "name": "judged",
        "applications": [{"name": "judge", "kind": "simulation", "source": "judge"}],
        "simulationBatch": {"createSimulationJobRequests": [request], "audit": {"lanes": 0}},
        "gate": {"successRate": {"atLeast": 0.01}},
    }
    run = simyard.run(document, base=tmp_path, store=tmp_path / "s", direct=True)
    assert run.verdict == "PASS"
    (row,) = simyard.results(run).table.to_pylist()
    assert (row["outcome"], row["world"].rpartition("/")[2], row["rooms_total"]) == ("Passed", "judge", 0)
    assert dict(row["metrics"])["distance"] > 0.3


def test_a_stage_that_fails_is_an_exception(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object) -> None:
        raise StageFailed("InternalServiceError", "no disk")

    monkeypatch.setattr("flows.pipeline.pipeline.pipeline", fail)
    with pytest.raises(StageFailed, match="no disk"):
        simyard.run(FILE, store=tmp_path / "s", direct=True)
