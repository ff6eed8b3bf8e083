"""A rule about a metric that no scenario measures is refused before anything runs."""

from pathlib import Path

import pytest

from flows.pipeline.bundle_checks import check_own_bundles
from flows.pipeline.references import resolve_references
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.storage.base.store import Store
from tests.flows.document.test_robot_files import EXPLODES
from tests.repository import ROOT

WAITS = 'class Patrol:\n    def metrics(self, state):\n        return {"waiting_s": state.waiting_s}\n'
COMPUTES = "class Patrol:\n    def metrics(self, state):\n        return measure(state)\n"


def patrolled(folder: Path, source: str, *columns: str, scenario: str = "patrol") -> PipelineSpec:
    """Returns a document that brings a scenario along, with a rule about each column."""
    (folder / "patrol/patrol").mkdir(parents=True)
    (folder / "patrol/patrol/rounds.py").write_text(source)
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
