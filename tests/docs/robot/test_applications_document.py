"""docs/guide/applications.md: its applications run as they stand there."""

import re
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import REPOSITORY, simulate_lanes
from tests.factories.worlds import apartment

FILES = re.compile(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", re.DOTALL)


@pytest.fixture(
    scope="module",
    params=["straight", *(pytest.param(name, marks=pytest.mark.long) for name in ("branching", "together"))],
)
def rows(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[EpisodeResult]:
    folder = tmp_path_factory.mktemp("documented")
    for name, text in FILES.findall((REPOSITORY / "docs/guide" / "applications.md").read_text()):
        path: Path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    digest = {"straight": "5", "branching": "7", "together": "8"}[request.param] * 64
    robot = ApplicationLaunch(name="slider", version="1", digest=digest, package="slider", launch_file=request.param)
    scenario = ApplicationLaunch(name="nearby", version="1", digest="6" * 64, package="nearby", launch_file="one_goal")
    requests = [
        EpisodeRequest(
            index=seed,
            world="hand/apartment",
            seed=seed,
            robot=robot,
            scenario=scenario,
            environment={"SPEED": speed},
            duration_s=3.0,
        )
        for seed, speed in enumerate(["0.2", "0.4", "0.05"])
    ]
    (chunk,) = plan_chunks(requests, 4)
    bundles = {robot.digest: folder / "slider", scenario.digest: folder / "nearby"}
    return simulate_lanes(chunk, {"hand/apartment": apartment()}, bundles, lanes=4, should_stop=lambda: False)


@pytest.mark.long
def test_the_documented_robot_does_the_documented_task(rows: list[EpisodeResult]):
    assert [row.failure_reason for row in rows] == ["", "", ""]
    assert [(row.outcome, row.outcome_reason) for row in rows[:2]] == [("Passed", ""), ("Passed", "")]


def test_the_documented_variable_sets_the_speed(rows: list[EpisodeResult]):
    # 0.45 m to go, 0.05 m before the goal it counts.
    assert [row.simulated_s for row in rows[:2]] == pytest.approx([0.45 / 0.2, 0.45 / 0.4], abs=0.2)
    assert (rows[2].outcome, rows[2].outcome_reason) == ("Failed", "timeout")
