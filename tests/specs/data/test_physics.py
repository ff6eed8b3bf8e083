"""Physical parameters among an episode's variables: what applications see of them, and which program they make."""

import pytest

from specs.data.physics import (
    CONTROL_DELAY,
    RANGES,
    application_variables,
    beyond_range,
    control_delay_steps,
    physical_factors,
    step_of,
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
