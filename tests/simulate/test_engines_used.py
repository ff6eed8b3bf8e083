"""A batch's record names the engines that ran, not the one that was asked for."""

from pathlib import Path

import pytest

from specs.episode import ApplicationLaunch
from tasks.simulate.batch_plan import BatchPlan, JobTemplate
from tasks.simulate.engines_used import engines_used

ROOT = Path(__file__).parents[2]
SCENARIO = ApplicationLaunch(name="delivery", version="1", digest="s", package="delivery", launch_file="rooms")


def plan(engine: str, *digests: str) -> BatchPlan:
    templates = tuple(
        JobTemplate(
            robot=ApplicationLaunch(name="r", version="1", digest=each, package="courier", launch_file="go_to_goal"),
            scenario=SCENARIO,
            environment={},
            duration_s=1.0,
            failure_behavior="Fail",
            worlds=(),
        )
        for each in digests
    )
    return BatchPlan(
        templates=templates, worlds=(), seeds=(), sweep={}, lanes=16, timeout_s=1.0, world_digests={}, engine=engine
    )


@pytest.mark.parametrize(("asked", "ran"), [("auto", "planar"), ("mujoco", "mujoco")])
def test_the_engine_that_ran_is_named(asked: str, ran: str) -> None:
    assert engines_used(plan(asked, "c"), {"c": ROOT / "applications" / "courier"}) == ran


def test_a_robot_that_no_engine_takes_ran_on_none(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text("<mujoco><worldbody/></mujoco>")
    assert engines_used(plan("auto", "x"), {"x": tmp_path}) == "none"
    assert engines_used(plan("auto", "x", "c"), {"x": tmp_path, "c": ROOT / "applications" / "courier"}) == "planar"
