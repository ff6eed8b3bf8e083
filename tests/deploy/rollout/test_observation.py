"""What a job's record says of how a roll-out ended."""

from tasks.deploy.fleet.states import RobotProgress
from tasks.deploy.rollout.observation import count_in_sync, rollout_end
from tasks.deploy.rollout.rollout_plan import Move, RolloutPlan

WHY = "run.sh exited with 1 within 1 s, and has to stay up; its output is in logs/000001-launch.log"
SEEN = {
    "r1": RobotProgress(status="Failed", failure_code="EnvironmentSetupError", failure_reason=WHY),
    "r2": RobotProgress(status="InSync"),
}


def test_a_failed_roll_out_gives_the_first_failed_robots_own_reason():
    plan = RolloutPlan.model_construct()
    end = rollout_end(plan, Move(verdict="Failed", why="canary"), SEEN)
    assert end.failure_reason == f"a canary failed; 1 of 2 robots failed (r1: EnvironmentSetupError); r1: {WHY}"


def test_a_robot_that_failed_does_not_fill_the_bar():
    assert count_in_sync(SEEN) == 1
