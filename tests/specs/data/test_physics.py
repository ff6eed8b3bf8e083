"""Physical parameters among an episode's variables: what applications see of them, and which program they make."""

from specs.data.physics import application_variables, physical_factors
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
    assert program_key(request(0, environment={})) not in keys
