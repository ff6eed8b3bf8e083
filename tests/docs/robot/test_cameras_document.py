"""docs/guide/cameras.md: its robots see what they drive at, on every engine, and its points lie where walls are."""

import re
from pathlib import Path

import numpy as np
import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import REPOSITORY, simulate_lanes
from tests.factories.worlds import apartment

FILES = re.compile(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", re.DOTALL)
GUIDE = REPOSITORY / "docs/guide"
PAGE = (GUIDE / "cameras.md").read_text()


@pytest.mark.long
@pytest.mark.parametrize(
    ("engine", "launched", "most_m"),
    [
        ("planar", "seeing", 0.6),
        ("mujoco", "seeing", 0.6),
        pytest.param("mjx", "seeing", 0.6, marks=pytest.mark.soak),
        ("planar", "looking", 0.9),
    ],
)
def test_the_documented_robots_stop_before_the_wall_that_they_see(
    engine: str, launched: str, most_m: float, tmp_path: Path
):
    for name, text in FILES.findall((GUIDE / "applications.md").read_text() + PAGE):
        path: Path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    robot = ApplicationLaunch(name="slider", version="1", digest="2e" * 32, package="slider", launch_file=launched)
    scenario = ApplicationLaunch(name="nearby", version="1", digest="2f" * 32, package="nearby", launch_file="one_goal")
    request = EpisodeRequest(
        index=0, world="hand/apartment", seed=4, robot=robot, scenario=scenario, environment={}, duration_s=15.0
    )
    (chunk,) = plan_chunks([request], 1)
    bundles = {robot.digest: tmp_path / "slider", scenario.digest: tmp_path / "nearby"}
    (row,) = simulate_lanes(
        chunk, {"hand/apartment": apartment()}, bundles, lanes=1, engine=engine, should_stop=lambda: False
    )
    assert (row.status, row.failure_reason) == ("Completed", "")
    assert row.path_length_m is not None
    assert row.path_length_m > 0.5
    assert row.min_clearance_m is not None
    assert 0.3 < row.min_clearance_m < most_m


def test_the_documented_points_of_a_wall_lie_in_its_plane():
    (block,) = re.findall(r"```python\n(import numpy.*?)```", PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(block, names)  # noqa: S102 - the page's own
    function = names["points"]
    assert callable(function)
    found = np.asarray(function(np.full((24, 32), 2.0)))
    np.testing.assert_allclose(found[..., 0], 2.1)
    assert found[0, 0, 1] > 0.0 > found[0, -1, 1]
    assert found[0, 0, 2] > 0.3 > found[-1, 0, 2]
