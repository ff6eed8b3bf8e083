"""Bounds that only RoboMaker's prose states, so that they are not part of the schema (semantics 3, 4, 8)."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from specs.deployment import DeploymentTimeout
from specs.simulation import BatchedJobDuration, JobDuration
from specs.simulation_batch import BatchPolicy


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


@pytest.mark.parametrize("policy", [{"timeoutInSeconds": 0}, {"timeoutInSeconds": 1_209_601}, {"maxConcurrency": 0}])
def test_a_batch_has_time_and_room_for_a_job(policy: dict[str, int]):
    with pytest.raises(ValidationError):
        BatchPolicy.model_validate(policy)
