import pytest

from tasks.deploy.fleet.launch_environment import environment, variable_faults


@pytest.mark.parametrize(
    "name", ["LD_PRELOAD", "LD_LIBRARY_PATH", "PYTHONPATH", "PATH", "BASH_ENV", "ENV", "IFS", "HOME", "SIMYARD_STORE"]
)
def test_a_variable_that_changes_which_code_runs_is_refused(name: str) -> None:
    assert [fault.path for fault in variable_faults([name], "environmentVariables")] == [f"environmentVariables.{name}"]


@pytest.mark.parametrize("name", ["MAX_SPEED", "ROS_MASTER_URI", "GOAL", "LDX", "PATHS", "ENVIRONMENT"])
def test_an_ordinary_variable_is_allowed(name: str) -> None:
    assert variable_faults([name], "environmentVariables") == []


def test_tags_become_variables_and_a_deployments_tag_wins() -> None:
    found = environment({"MAX_SPEED": "1"}, {"site": "hall", "floor": "2"}, {"site": "yard"})

    assert found == {
        "MAX_SPEED": "1",
        "AWS_ROBOMAKER_ROBOT_TAG_KEY_site": "yard",
        "AWS_ROBOMAKER_ROBOT_TAG_KEY_floor": "2",
    }
