import pytest

from tasks.deploy.fleet.launch_environment import environment, variable_faults

CODE = """
LD_PRELOAD LD_LIBRARY_PATH PYTHONPATH PYTHONSTARTUP PATH BASH_ENV BASH_FUNC_ls%% ENV IFS HOME PS4 SIMYARD_STORE
_JAVA_OPTIONS JAVA_TOOL_OPTIONS JDK_JAVA_OPTIONS CLASSPATH PERLLIB PERL5LIB PERL5OPT PERL5DB LUA_INIT LUA_INIT_5_4
LUA_PATH LUA_CPATH_5_3 PHPRC PHP_INI_SCAN_DIR OPENSSL_CONF OPENSSL_MODULES RUBYOPT RUBYLIB GEM_PATH NODE_OPTIONS
NODE_PATH
GIT_SSH_COMMAND GIT_EXEC_PATH GIT_CONFIG_COUNT GCONV_PATH LOCPATH QT_PLUGIN_PATH GTK_MODULES GTK_PATH GIO_EXTRA_MODULES
GST_PLUGIN_PATH GST_PLUGIN_SYSTEM_PATH_1_0 DOTNET_STARTUP_HOOKS R_PROFILE_USER LESSOPEN
"""
ORDINARY = """
MAX_SPEED GOAL LDX PATHS ENVIRONMENT TMPDIR LANG TZ DISPLAY QT_QPA_PLATFORM GST_DEBUG CUDA_VISIBLE_DEVICES
ROS_MASTER_URI ROS_DOMAIN_ID ROS_PACKAGE_PATH RMW_IMPLEMENTATION AMENT_PREFIX_PATH CYCLONEDDS_URI
FASTRTPS_DEFAULT_PROFILES_FILE RCUTILS_LOGGING_SEVERITY GAZEBO_MODEL_PATH TURTLEBOT3_MODEL COLCON_PREFIX_PATH
"""


@pytest.mark.parametrize("name", CODE.split())
def test_a_variable_that_changes_which_code_runs_is_refused(name: str) -> None:
    assert [fault.path for fault in variable_faults([name], "environmentVariables")] == [f"environmentVariables.{name}"]


def test_a_variable_with_a_line_feed_does_not_slip_through() -> None:
    assert variable_faults(["BASH_FUNC_a\nb%%"], "environmentVariables")


@pytest.mark.parametrize("name", ORDINARY.split())
def test_an_ordinary_variable_is_allowed(name: str) -> None:
    assert variable_faults([name], "environmentVariables") == []


def test_tags_become_variables_and_a_deployments_tag_wins() -> None:
    found = environment({"MAX_SPEED": "1"}, {"site": "hall", "floor": "2"}, {"site": "yard"})

    assert found == {
        "MAX_SPEED": "1",
        "AWS_ROBOMAKER_ROBOT_TAG_KEY_site": "yard",
        "AWS_ROBOMAKER_ROBOT_TAG_KEY_floor": "2",
    }
