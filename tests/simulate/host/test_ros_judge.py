"""What tags and test nodes say of an episode, and what its row becomes."""

from collections.abc import Mapping

import pytest

from tasks.simulate.host.ros_judge import Judgement, TimeOver, judged_by, judged_row, tag_metrics
from tests.factories.episodes import passed


@pytest.mark.parametrize(
    ("tags", "tests", "said"),
    [
        ({}, None, None),
        ({"found": "a wall"}, None, None),
        ({"rotate_test_Status": "Passed"}, None, True),
        ({"result": "pass"}, None, True),
        ({"a_Status": "Passed", "b_Status": "FAILED"}, None, False),
        ({}, True, True),
        ({}, False, False),
        ({"result": "pass"}, False, False),
        ({"result": "fail"}, True, False),
    ],
)
def test_one_that_failed_decides_then_one_that_passed(
    tags: Mapping[str, str], *, tests: bool | None, said: bool | None
):
    assert judged_by(tags, tests=tests) is said


def test_tags_that_are_numbers_are_metrics_by_the_names_that_metrics_have():
    tags = {"Time Elapsed": "12.5", "laps": "3", "status": "Passed", "far": "inf", "7": "1", "none": "nan"}
    assert tag_metrics(tags) == {"time_elapsed": 12.5, "laps": 3.0}


@pytest.mark.parametrize(
    ("said", "time_over", "outcome", "reason"),
    [
        (True, "failed", "Passed", ""),
        (False, "passed", "Failed", "judged"),
        (None, "failed", "Failed", "timeout"),
        (None, "passed", "Passed", ""),
    ],
)
def test_a_row_says_what_was_judged_and_else_what_is_declared(
    *, said: bool | None, time_over: TimeOver, outcome: str, reason: str
):
    row = judged_row(passed(0), Judgement(said, ended=False, time_over=time_over, tags={"laps": "3"}))
    assert (row.status, row.outcome, row.outcome_reason, row.goals_total) == ("Completed", outcome, reason, 0)
    assert row.metrics["laps"] == 3.0
