"""Episodes that nodes of ROS 1 drive have the same rows, whether one, eight or thirty-two are simulated at once."""

import shutil
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest
from specs.data.world import World
from tasks.simulate.plan.chunks import Chunk
from tests.factories.simulations import BUNDLES, DRIFT, FOLDERS, pushing, simulate_lanes
from tests.ros.conftest import courier, wheel

__all__ = ["courier", "wheel"]

COURIER = "6" * 64
SEEDS, SECONDS = 4, 4.0


def requests(application: str) -> list[EpisodeRequest]:
    launch = f"{application}.launch"
    robot = ApplicationLaunch(name="courier", version="1", digest=COURIER, package="courier", launch_file=launch)
    return [
        pushing(index, world=f"hand/pen-{index % 3}", seed=index % SEEDS, duration_s=SECONDS).model_copy(
            update={"robot": robot, "environment": {}}
        )
        for index in range(32)
    ]


@pytest.mark.soak
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("application", ["answer", "listen", "steady", "relay", "wheel"])
def test_rows_are_the_same_with_one_eight_and_thirty_two_lanes(
    wheel: Path, pens: dict[str, World], tmp_path: Path, application: str
):
    bundle = tmp_path / "bundle"
    shutil.copytree(wheel, bundle)
    shutil.copy(BUNDLES / "patrol" / "robot.xml", bundle / "robot.xml")
    folders, asked = {COURIER: bundle, DRIFT: FOLDERS[DRIFT]}, requests(application)

    def rows(part: list[EpisodeRequest], lanes: int) -> list[str]:
        chunk = Chunk(number=0, requests=tuple(part))
        found = simulate_lanes(chunk, pens, folders, lanes=lanes, should_stop=lambda: False)
        assert {(row.status, row.late, row.stray) for row in found} == {("Completed", 0, 0)}
        assert all(row.path_length_m > 0.0 for row in found)
        return [row.model_dump_json() for row in found]

    together = rows(asked, 32)
    assert [row for start in range(0, 32, 8) for row in rows(asked[start : start + 8], 8)] == together
    assert [row for each in asked[:SEEDS] for row in rows([each], 8)] == together[:SEEDS]
