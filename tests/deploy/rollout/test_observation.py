"""What a job's record says of how a roll-out ended."""

import pytest

from tasks.deploy.fleet.states import RobotProgress
from tasks.deploy.rollout.observation import count_in_sync, recorded_progress, rollout_end, standing
from tasks.deploy.rollout.rollout_plan import Move, RolloutPlan
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import STAYS_UP, Yard

WHY = "run.sh exited with 1 within 1 s, and has to stay up; its output is in logs/000001-launch.log"
BACK = RobotProgress(
    status="Failed",
    step="Launching",
    failure_code="EnvironmentSetupError",
    failure_reason=WHY,
    runs="courier 1",
    started_at_s=1.0,
)
NEVER = RobotProgress(status="Failed", failure_code="RobotDeploymentAborted", runs="courier 1")
SEEN = {"r1": BACK, "r2": RobotProgress(status="InSync", runs="courier 2")}


def test_a_failed_roll_out_says_who_runs_what_and_the_first_failed_robots_own_reason():
    plan = RolloutPlan.model_construct(application="courier", version=2)
    end = rollout_end(plan, Move(verdict="Failed", why="canary"), SEEN)
    runs = "1 of 2 robots runs courier 2 (r2), 1 runs courier 1; went back to courier 1: r1"
    assert end.failure_reason == f"{runs}; a canary failed; 1 of 2 robots failed (r1: EnvironmentSetupError); r1: {WHY}"


def test_a_robot_that_failed_does_not_fill_the_bar():
    assert count_in_sync(SEEN) == 1


def _like(robot: RobotProgress, **changes: object) -> RobotProgress:
    return robot.model_copy(update=changes)


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (BACK, "1 runs courier 1; went back to courier 1: r2"),
        (_like(BACK, runs="courier 2"), "1 runs courier 2 as before; went back to courier 2 as before: r2"),
        (_like(BACK, runs="nothing"), "1 runs nothing; failed, left with nothing: r2"),
        (_like(BACK, step="DownloadingExtracting"), "1 runs courier 1; failed, left on courier 1: r2"),
        (NEVER, "1 runs courier 1; never asked, left on courier 1: r2"),
        (_like(NEVER, runs=""), "never asked: r2"),
        (_like(NEVER, started_at_s=1.0), "1 runs courier 1; asked no more, left on courier 1: r2"),
        (_like(BACK, status="NoResponse"), "no answer in time, will take it when back (last on courier 1): r2"),
        (_like(BACK, status="Deploying"), "1 runs courier 1; under way: r2"),
        (RobotProgress(status="Registered"), "not asked yet: r2"),
    ],
)
def test_what_became_of_each_robot_is_said(robot: RobotProgress, said: str):
    first, _, rest = standing("courier 2", {"r1": SEEN["r2"], "r2": robot}).partition(" (r1)")
    assert first == "1 of 2 robots runs courier 2"
    assert rest[2:] == said


def test_many_robots_are_counted_and_a_few_are_named():
    seen = {f"r{number}": BACK for number in range(9)}
    assert standing("courier 2", seen) == (
        "0 of 9 robots run courier 2, 9 run courier 1; went back to courier 1: r0, r1, r2, r3, r4, ..."
    )
    assert standing("courier 2", dict.fromkeys(seen, SEEN["r2"])) == "9 of 9 robots run courier 2"


def test_a_record_says_what_also_those_run_that_were_never_asked(yard: Yard):
    robots, old, new = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP}), yard.publish({"run.sh": "#!/x"})
    assert run(yard, robots, yard.request(old, "one"), old.digest).status == "Succeeded"
    robots.failing = {"r0", "r1"}
    record = run(yard, robots, yard.request(new, "two"), new.digest)

    assert {robot: each.runs for robot, each in recorded_progress(record).items()} == {
        **dict.fromkeys(["r0", "r1", "r2", "r3", "r4"], "courier 1")
    }
    assert record.failure_reason.startswith("0 of 5 robots run courier 2, 5 run courier 1; went back to courier 1: r0,")
    assert "; never asked, left on courier 1: r2, r3, r4; 2 of 5 robots failed" in record.failure_reason
