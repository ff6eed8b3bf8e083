"""Physical parameters among an episode's variables: what applications see of them, and which program they make."""

import pytest

from specs.data.people import People
from specs.data.physics import (
    CONTROL_DELAY,
    RANGES,
    VariedStart,
    application_variables,
    beyond_range,
    control_delay_steps,
    no_such_people,
    physical_factors,
    step_of,
    varied_goals,
    varied_people,
    varied_start,
)
from tasks.simulate.plan.chunks import program_key, split_environment
from tests.factories.episodes import request


def test_factors_that_are_not_named_are_1():
    assert physical_factors({"MAX_SPEED": "0.5"}) is None
    assert physical_factors({"robot.friction": "0.5", "A": "x"}) == (1.0, 0.5, 1.0)


def test_applications_do_not_see_them():
    environment = {"robot.mass": "1.1", "MAX_SPEED": "0.5", "PLANNER": "a"}
    assert application_variables(environment) == {"MAX_SPEED": "0.5", "PLANNER": "a"}
    assert split_environment(environment) == ({"MAX_SPEED": 0.5}, {"PLANNER": "a"})


def test_a_sweep_over_them_is_one_program():
    keys = {
        program_key(request(0, environment=own))
        for own in ({"robot.mass": "1"}, {"robot.mass": "1.1"}, {"robot.friction": "2"})
    }
    assert len(keys) == 1
    late = {program_key(request(0, environment={CONTROL_DELAY: own})) for own in ("0", "0.05", "1")}
    assert len(late) == 1
    assert not late & keys
    assert program_key(request(0, environment={})) not in keys


def test_a_delay_is_a_whole_number_of_control_steps():
    assert control_delay_steps({"robot.mass": "1"}) is None
    assert [control_delay_steps({CONTROL_DELAY: each}) for each in ("0", "0.15", "1")] == [0, 3, 20]
    assert (step_of(CONTROL_DELAY), step_of("robot.mass"), step_of("MAX_SPEED")) == (0.05, 0.0, 0.0)
    assert {CONTROL_DELAY, "MAX_SPEED"} - application_variables({CONTROL_DELAY: "0", "MAX_SPEED": "1"}).keys() == {
        CONTROL_DELAY
    }


@pytest.mark.parametrize(
    ("value", "right"),
    [(0, True), (0.15, True), (1.0, True), (1.05, False), (-0.05, False), (0.07, False), (True, False)],
)
def test_a_delay_is_within_its_range_at_both_ends(value: object, *, right: bool):
    assert RANGES[CONTROL_DELAY].has(value) is right
    found = [*beyond_range({CONTROL_DELAY: [0.1, value], "robot.colour": 0}, ("physics",))]
    assert [(each.loc, each.allowed) for each in found] == (
        [] if right else [(("physics", CONTROL_DELAY, 1), "a number from 0 to 1, a multiple of 0.05")]
    )


def test_an_episodes_variables_say_what_its_people_are_like():
    own = {"people.count": "4", "people.speed_ms": "0.7", "people.unaware": "1", "A": "x"}
    assert varied_people(People(count=2), own) == People(count=4, speed_ms=0.7, unaware=1.0)
    assert varied_people(People(count=2, speed_ms=1.5), {"people.unaware": "0.5"}) == People(
        count=2, speed_ms=1.5, unaware=0.5
    )
    assert varied_people(None, own) is None
    assert application_variables(own) == {"A": "x"}


def test_people_vary_where_there_are_some_and_their_speed_where_they_choose_it():
    names = ["people.speed_ms", "robot.mass", "people.count", "A"]
    assert [name for name, _ in no_such_people(names, None)] == ["people.speed_ms", "people.count"]
    assert [*no_such_people(names, 3)] == [*no_such_people(names, {"count": 3})] == []
    assert [name for name, _ in no_such_people(names, {"count": 3, "model": "recorded"})] == ["people.speed_ms"]


def test_an_episodes_variables_say_where_it_begins():
    assert varied_start({"MAX_SPEED": "0.5"}) is None
    assert varied_start({"start.x_share": "0"}) == VariedStart(0.0, None, None)
    assert varied_start({"start.y_share": "1", "start.yaw_rad": "-0.5"}) == VariedStart(None, 1.0, -0.5)
    assert application_variables({"start.x_share": "0", "A": "x"}) == {"A": "x"}


def test_an_episodes_variables_say_by_which_shares_its_goals_are_drawn():
    assert varied_goals({"MAX_SPEED": "0.5", "start.x_share": "0.5"}) == ()
    assert varied_goals({"goals.x1_share": "0", "goals.y1_share": "0.25"}) == ((0.0, 0.25), None)
    assert varied_goals({"goals.y2_share": "0"}) == (None, (0.5, 0.0))
    assert application_variables({"goals.x1_share": "0", "A": "x"}) == {"A": "x"}
