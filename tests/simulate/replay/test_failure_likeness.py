"""What makes two failures the same: kind, goal and place, each by itself."""

import pytest

from specs.data.episode import Failure, failed_result
from tasks.simulate.replay.smallest_case import Ending, is_of_same_kind, is_same_failure

ROW = failed_result(0, Failure("InternalServiceError", "noted")).model_copy(
    update={"status": "Completed", "failure_code": "", "outcome_reason": "collision", "goals_reached": 1}
)
FIRST = Ending(ROW, (3.0, 2.0))


def _changed(goal_m: tuple[float, float] | None = FIRST.goal_m, **changes: object) -> Ending:
    return Ending(ROW.model_copy(update=changes), goal_m)


@pytest.mark.parametrize(
    "other",
    [
        _changed(final_x_m=0.7, final_y_m=-0.7),
        _changed((3.6, 1.4)),
        _changed(simulated_s=9.0, collisions=3),
    ],
)
def test_within_a_metre_it_is_the_same_failure(other: Ending):
    assert is_same_failure(FIRST, other)


@pytest.mark.parametrize(
    "other",
    [
        _changed(final_x_m=0.8, final_y_m=-0.8),
        _changed((3.8, 1.2)),
        _changed(None),
        _changed(goals_reached=0),
    ],
    ids=["elsewhere", "to a goal elsewhere", "to no known goal", "to the goal before"],
)
def test_elsewhere_or_on_another_way_it_is_another_failure_of_that_kind(other: Ending):
    assert is_of_same_kind(FIRST, other)
    assert not is_same_failure(FIRST, other)


@pytest.mark.parametrize(
    "other",
    [_changed(outcome_reason="stuck"), _changed(failure_code="RobotApplicationCrash"), _changed(status="Failed")],
    ids=["reason", "code", "status"],
)
def test_with_another_reason_it_is_no_failure_of_that_kind(other: Ending):
    assert not is_of_same_kind(FIRST, other)
    assert not is_same_failure(FIRST, other)


def test_of_episodes_that_never_began_the_reason_says_all():
    assert is_same_failure(Ending(ROW), Ending(ROW))
