"""The gate's rules in a document: what may stand there, all faults at once, and old documents as they were."""

from typing import Any

import pytest
from pydantic import ValidationError

from specs.base import canonical_document
from specs.data.result_columns import MEASURED, MEASURES
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate, metric_faults, stops_early
from tests.specs.pipeline.test_document import BATCH, GENERATION

QUANTILE: dict[str, Any] = {"column": "min_clearance_m", "quantile": 0.05, "atLeast": 0.1}


def faults(gate: object, **batch: object) -> dict[str, str]:
    with pytest.raises(ValidationError) as caught:
        PipelineSpec.model_validate(
            {"name": "nightly", "worldGeneration": GENERATION, "simulationBatch": {**BATCH, **batch}, "gate": gate}
        )
    return {".".join(map(str, error["loc"])): error["msg"] for error in caught.value.errors()}


def test_a_gate_with_a_success_rate_alone_is_the_document_that_it_was():
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9}})
    assert canonical_document(gate) == {"successRate": {"atLeast": 0.9, "confidence": 0.95}}
    assert not stops_early(gate)


def test_all_rules_may_stand_together():
    document = {
        "successRate": {"atLeast": 0.9, "confidence": 0.99},
        "noWorseThan": {"applicationVersion": "3", "margin": 0.02, "confidence": 0.95},
        "collisionRate": {"atMost": 0.05, "confidence": 0.95},
        "maxOutcomeFlipRate": {"atMost": 0.2, "confidence": 0.95},
        "quantiles": [{**QUANTILE, "confidence": 0.95}],
        "stopEarly": True,
    }
    assert canonical_document(Gate.model_validate(document)) == document
    assert stops_early(Gate.model_validate(document))


def test_a_gate_without_rules_is_refused():
    rules = "successRate, noWorseThan, collisionRate, maxOutcomeFlipRate, quantiles, failureProbability"
    assert faults({}) == faults({"quantiles": []}) == {"gate": f"at least one of {rules}"}


def test_only_rules_that_count_episodes_can_stop_a_batch():
    assert faults({"quantiles": [QUANTILE], "stopEarly": True}) == {
        "gate.stopEarly": "successRate or noWorseThan or collisionRate beside it, which can be sure early"
    }


@pytest.mark.parametrize("bars", [{}, {"atLeast": 0.1, "atMost": 0.2}])
def test_a_quantile_has_one_bar(bars: dict[str, float]):
    rule = {"column": "spl", "quantile": 0.5, **bars}
    assert faults({"quantiles": [rule]}) == {"gate.quantiles.0": "one of atLeast and atMost"}


def test_a_column_is_one_of_the_results_or_a_scenarios_own():
    found = faults({"quantiles": [{**QUANTILE, "column": "clearance"}]})
    assert found["gate.quantiles.0.column"].startswith('did you mean "min_clearance_m"? one of simulated_s, ')
    assert "metrics.<name>" in found["gate.quantiles.0.column"]
    Gate.model_validate({"quantiles": [{**QUANTILE, "column": "metrics.parcels per hour"}]})


@pytest.mark.parametrize(("column", "movers"), [("min_person_m", "people"), ("min_robot_m", "robots")])
def test_how_a_robot_meets_others_is_asked_only_where_there_are_some(column: str, movers: str):
    gate = {"quantiles": [{"column": column, "quantile": 0.05, "atLeast": 0.1}]}
    assert f"simulationBatch.{movers} puts {movers}" in faults(gate)["gate.quantiles.0.column"]
    document = {
        "name": "nightly",
        "worldGeneration": GENERATION,
        "simulationBatch": {**BATCH, movers: 2},
        "gate": gate,
    }
    PipelineSpec.model_validate(document)
    if movers == "robots":
        with pytest.raises(ValidationError, match="a batch without robots has"):
            PipelineSpec.model_validate({**document, "simulationBatch": {**BATCH, movers: 1}})


def test_a_rule_about_what_navigation_says_of_itself_is_no_fault_of_any_scenario():
    quantiles = [{**QUANTILE, "column": f"metrics.{name}"} for name in ("navigation_recoveries", "recoveries")]
    (fault,) = metric_faults(Gate.model_validate({"quantiles": quantiles}), ["waiting_s"])
    assert fault.value == '"metrics.recoveries"'


def test_the_columns_are_the_numbers_that_the_results_have():
    lists = {"goal_times_s", "metrics", "rooms_entered", "rooms_unreachable"}
    of_the_world = {"rooms_total"}
    assert tuple(field.name for field in MEASURED if field.name not in lists | of_the_world) == MEASURES


def test_a_quantile_of_a_column_is_asked_once_from_each_side():
    assert faults({"quantiles": [QUANTILE, {**QUANTILE, "atLeast": 0.2}]}) == {
        "gate.quantiles.1": "each quantile of a column once from below and once from above"
    }
    above = {"column": "min_clearance_m", "quantile": 0.05, "atMost": 1.0}
    Gate.model_validate({"quantiles": [QUANTILE, above, {**QUANTILE, "quantile": 0.5}]})


def test_a_rule_about_the_audit_needs_one():
    assert faults({"maxOutcomeFlipRate": {"atMost": 0.2}}, audit={"lanes": 0}) == {
        "gate.maxOutcomeFlipRate": "simulationBatch.audit.lanes above 0, for the episodes that it counts"
    }


def test_all_faults_are_told_at_once():
    found = faults(
        {
            "successRate": {"atLeast": 1.0},
            "noWorseThan": {"applicationVersion": 3, "margin": -0.1},
            "collisionRate": {"atMost": 0},
            "quantiles": [{"column": "nothing", "quantile": 1.0}],
        }
    )
    assert set(found) == {
        "gate.successRate.atLeast",
        "gate.noWorseThan.applicationVersion",
        "gate.noWorseThan.margin",
        "gate.collisionRate.atMost",
        "gate.quantiles.0.column",
        "gate.quantiles.0.quantile",
        "gate.quantiles.0",
    }


OVER: dict[str, Any] = {
    "successRate": {"atLeast": 0.9, "over": "worlds"},
    "quantiles": [{**QUANTILE, "over": "worlds"}],
}


def test_a_rule_over_worlds_is_refused_where_the_batch_certainly_has_one():
    allowed = "2 worlds or more in the batch; one world says nothing of others"
    one = faults(OVER, matrix={"worlds": ["g/only"]})
    assert one == {"gate.successRate.over": allowed, "gate.quantiles.0.over": allowed}
    PipelineSpec.model_validate(
        {"name": "n", "simulationBatch": {**BATCH, "matrix": {"worlds": ["g/a", "g/b"]}}, "gate": OVER}
    )


def test_a_rule_over_worlds_needs_the_whole_batch():
    found = faults({**OVER, "stopEarly": True})
    assert set(found) == {"gate.successRate.over", "gate.quantiles.0.over"}
    assert all("stopEarly" in allowed for allowed in found.values())


def test_what_a_document_does_not_say_is_no_part_of_its_digest():
    quantile = Gate.model_validate({"quantiles": [QUANTILE]})
    assert canonical_document(quantile) == {"quantiles": [{**QUANTILE, "confidence": 0.95}]}
    worst = Gate.model_validate({"quantiles": [{**QUANTILE, "failed": "worst"}]})
    assert canonical_document(worst) == {"quantiles": [{**QUANTILE, "confidence": 0.95, "failed": "worst"}]}
