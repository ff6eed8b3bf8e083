"""Bounds that only RoboMaker's prose states (docs/reference/robomaker.md, sections 3, 4, 8)."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.deployment import DeploymentTimeout
from specs.robomaker.simulation import BatchedJobDuration, BatchPolicy, JobDuration


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [
        (TypeAdapter(JobDuration), 1, 1_209_600),
        (TypeAdapter(BatchedJobDuration), 1, 691_200),
        (TypeAdapter(DeploymentTimeout), 60, 604_800),
    ],
)
def test_seconds_lie_between_the_limits_and_not_beyond(kind: TypeAdapter[Any], low: int, high: int):
    assert [kind.validate_python(seconds) for seconds in (low, high)] == [low, high]
    for seconds in (low - 1, high + 1):
        with pytest.raises(ValidationError, match=f"from {low:,} to {high:,} seconds"):
            kind.validate_python(seconds)


def test_the_shortest_job_may_be_that_of_robomakers_console(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MIN_JOB_DURATION", "300")
    for kind, most in ((TypeAdapter[int](JobDuration), "1,209,600"), (TypeAdapter[int](BatchedJobDuration), "691,200")):
        assert kind.validate_python(300) == 300
        with pytest.raises(ValidationError, match=f"from 300 to {most} seconds"):
            kind.validate_python(299)


def _section(seconds: int, **changes: object) -> dict[str, Any]:
    return {"createSimulationJobRequests": [{"maxJobDurationInSeconds": seconds}], **changes}


def test_eight_days_are_the_most_in_a_batch_and_fourteen_for_a_single_job():
    assert SimulationBatch.model_validate(_section(691_200))
    with pytest.raises(ValidationError, match="from 1 to 691,200 seconds in a batch"):
        SimulationBatch.model_validate(_section(691_201))
    single = {"operation": "CreateSimulationJob"}
    assert SimulationBatch.model_validate(_section(1_209_600, **single))
    with pytest.raises(ValidationError, match="from 1 to 1,209,600 seconds"):
        SimulationBatch.model_validate(_section(1_209_601, **single))


def test_a_single_job_is_one():
    two = [{"maxJobDurationInSeconds": 60}] * 2
    with pytest.raises(ValidationError, match="a CreateSimulationJob makes one job"):
        SimulationBatch.model_validate({"operation": "CreateSimulationJob", "createSimulationJobRequests": two})


@pytest.mark.parametrize("policy", [{"timeoutInSeconds": 0}, {"timeoutInSeconds": 1_209_601}, {"maxConcurrency": 0}])
def test_a_batch_has_time_and_room_for_a_job(policy: dict[str, int]):
    with pytest.raises(ValidationError):
        BatchPolicy.model_validate(policy)
