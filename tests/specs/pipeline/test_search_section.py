"""What a search may vary: distributions, each of one kind, and all faults at once."""

import pytest
from pydantic import JsonValue

from specs.errors import DocumentError
from specs.pipeline.search_section import Search
from tasks.documents.parse import parse

OVER: dict[str, JsonValue] = {
    "MAX_SPEED": {"uniform": [0.2, 0.8]},
    "ODOMETRY_SIGMA": {"logUniform": [0.01, 0.3]},
    "MASS": {"normal": {"mean": 1.0, "sd": 0.1, "atLeast": 0.5}},
    "PLANNER": {"choice": ["a", "b"]},
}


def faults(**changes: JsonValue) -> list[str]:
    with pytest.raises(DocumentError) as refused:
        parse(Search, {"over": {**OVER}, **changes}, "search")
    return [str(each.path) for each in refused.value.faults]


def test_four_kinds_of_distributions_and_defaults():
    search = parse(Search, {"over": {**OVER}}, "search")
    assert (search.measure, search.budget.episodes, search.seed) == ("min_clearance_m", 20_000, 0)
    assert (search.estimate.relativeError, search.estimate.confidence) == (None, 0.95)
    assert search.over["PLANNER"].choice == ("a", "b")


def test_nothing_but_worlds_and_seeds_may_vary():
    assert parse(Search, {"over": {}}, "search").over == {}


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"uniform": [0.2, 0.8], "choice": ["a", "b"]},
    ],
)
def test_a_distribution_is_of_exactly_one_kind(wrong: dict[str, JsonValue]):
    assert faults(over={"SPEED": wrong}) == ["over.SPEED"]


@pytest.mark.parametrize(
    ("wrong", "place"),
    [
        ({"uniform": [0.8, 0.2]}, "uniform"),
        ({"logUniform": [0.0, 0.2]}, "logUniform[0]"),
        ({"uniform": [0.2]}, "uniform[1]"),
        ({"normal": {"mean": 0, "sd": 0}}, "normal.sd"),
        ({"normal": {"mean": 0, "sd": 1, "atLeast": 2, "atMost": 1}}, "normal.atMost"),
        ({"choice": ["a"]}, "choice"),
        ({"triangular": [0, 1]}, ""),
    ],
)
def test_bounds_that_leave_nothing_are_refused(wrong: dict[str, JsonValue], place: str):
    assert f"over.SPEED.{place}".rstrip(".") in faults(over={"SPEED": wrong})


def test_all_faults_are_told_at_once():
    found = faults(
        over={"robot.colour": {"uniform": [0.9, 1.1]}},
        measure="distance",
        budget={"episodes": 10},
        estimate={"confidence": 1.0, "relativeError": 0.001},
    )
    places = ["budget.episodes", "estimate.confidence", "estimate.relativeError", "measure", "over.robot.colour"]
    assert sorted(found) == places


def test_a_budget_below_the_pilot_says_what_it_may_be():
    with pytest.raises(DocumentError, match="from 1,000 to 1,000,000 episodes, of which a pilot takes up to a quarter"):
        parse(Search, {"over": {}, "budget": {"episodes": 999}}, "search")


@pytest.mark.parametrize(
    "over",
    [
        {"normal": {"mean": 1.0, "sd": 0.1}},
        {"normal": {"mean": 1.0, "sd": 0.1, "atLeast": 0.0, "atMost": 2.0}},
        {"uniform": [0.5, 11.0]},
        {"choice": ["1", "2"]},
    ],
)
def test_a_physical_parameter_stays_within_bounds(over: JsonValue):
    assert faults(over={"robot.mass": over}) == ["over.robot.mass"]


@pytest.mark.parametrize("over", [{"uniform": [0.0, 1.05]}, {"uniform": [0.0, 0.12]}, {"uniform": [-0.05, 0.1]}])
def test_a_control_delay_has_bounds_that_are_whole_control_steps(over: JsonValue):
    assert faults(over={"robot.controlDelay_s": over}) == ["over.robot.controlDelay_s"]
    parse(Search, {"over": {"robot.controlDelay_s": {"uniform": [0.0, 1.0]}}}, "search")


def test_a_physical_parameter_is_searched_by_its_name_alone():
    one: JsonValue = {"normal": {"mean": 1.0, "sd": 0.1, "atLeast": 0.5, "atMost": 1.5}}
    assert [*parse(Search, {"over": {"robot.mass": one}}, "search").over] == ["robot.mass"]
    with pytest.raises(DocumentError, match="an environment variable, or one of"):
        parse(Search, {"over": {"robot.colour": one}}, "search")
