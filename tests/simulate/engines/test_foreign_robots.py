"""Robots that nobody here wrote, from gymnasium's wheel, as they are."""

import importlib.util
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.engines.engine_table import choose_engine
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import BUNDLES, DELIVERY, FOLDERS, SCENARIO, hall, simulate_lanes

pytestmark = pytest.mark.long

LANES = 4
ROBOTS = {"point": "1", "ant": "2", "humanoid": "3"}
DRUM = "4"  # the point again, on a cylinder that leans, which MJX collides with no box


def gymnasiums(name: str) -> Path:
    """Returns a robot's file in gymnasium's wheel, which need not be imported for it."""
    spec = importlib.util.find_spec("gymnasium")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "envs" / "mujoco" / "assets" / f"{name}.xml"


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The robots' applications, by digest, and the shipped scenario."""
    folder = tmp_path_factory.mktemp("gymnasium")
    for name in ROBOTS:
        shutil.copytree(BUNDLES / "foreign", folder / name)
        shutil.copy(gymnasiums(name), folder / name / "robot.xml")
    shutil.copytree(folder / "point", folder / "drum")
    point = gymnasiums("point").read_text()
    (folder / "drum" / "robot.xml").write_text(
        point.replace('size="0.5" type="sphere"', 'size="0.5 0.4" type="cylinder" euler="20 0 0"')
    )
    shipped = {DRUM * 64: folder / "drum", DELIVERY: FOLDERS[DELIVERY]}
    return {ROBOTS[name] * 64: folder / name for name in ROBOTS} | shipped


def request(index: int, robot: str, launch: str, environment: Mapping[str, str], duration_s: float) -> EpisodeRequest:
    return EpisodeRequest(
        index=index,
        world="hand/hall",
        seed=index,
        robot=ApplicationLaunch(
            name=robot, version="1", digest=ROBOTS.get(robot, DRUM) * 64, package="foreign", launch_file=launch
        ),
        scenario=SCENARIO,
        environment=dict(environment),
        duration_s=duration_s,
    )


def run(
    requests: Sequence[EpisodeRequest], world: World, bundles: dict[str, Path], engine: str = "auto"
) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(requests, LANES)
    return simulate_lanes(chunk, {"hand/hall": world}, bundles, lanes=LANES, engine=engine, should_stop=lambda: False)


@pytest.mark.long
def test_gymnasiums_point_delivers(bundles: dict[str, Path]):
    # It is pushed along x alone: in a hall this narrow all floor that it fits on lies ahead or behind.
    requests = [request(k, "point", "to_and_fro", {}, 120.0) for k in range(LANES)]
    rows = run(requests, hall(1.45), bundles)
    assert [row.failure_reason for row in rows] == [""] * LANES
    assert {(row.status, row.outcome, row.goals_reached) for row in rows} == {("Completed", "Passed", 2)}
    assert all(row.path_length_m > 2.0 for row in rows)


@pytest.mark.long
def test_a_robot_that_mjx_refuses_is_told_why_and_delivers_on_mujoco(bundles: dict[str, Path]):
    requests = [request(0, "drum", "to_and_fro", {}, 120.0)]
    (refused,) = run(requests, hall(1.45), bundles, engine="mjx")
    assert (refused.status, refused.failure_code) == ("Failed", "RobotApplicationCrash")
    assert "geom 'pointbody': MJX cannot collide a cylinder with boxes: use a sphere" in refused.failure_reason
    assert "or set engine: mujoco" in refused.failure_reason
    for engine in ("auto", "mujoco"):
        (row,) = run(requests, hall(1.45), bundles, engine=engine)
        assert (row.engine, row.outcome, row.failure_reason) == ("mujoco", "Passed", "")


@pytest.mark.parametrize("robot", ["half_cheetah", "hopper"])
def test_a_robot_that_stays_in_an_upright_plane_is_refused_once_with_the_remedy(tmp_path: Path, robot: str):
    with pytest.raises(
        RobotRefused, match=r"rootz \(slide along z\), rooty \(hinge about y\).*put <freejoint/>"
    ) as told:
        choose_engine("auto", gymnasiums(robot), "jax", "cpu")
    assert str(told.value).count("rootz") == 1


@pytest.mark.parametrize(("robot", "actuators"), [("ant", "x8"), ("humanoid", "x17")])
def test_what_walks_runs_and_stays_finite(bundles: dict[str, Path], robot: str, actuators: str):
    requests = [request(k, robot, "swinging", {"ACTUATORS": actuators}, 2.0) for k in range(LANES)]
    rows = run(requests, hall(3.0), bundles)
    assert {(row.status, row.outcome_reason, row.simulated_s) for row in rows} == {("Completed", "timeout", 2.0)}
    for row in rows:
        assert np.isfinite([value for value in row.model_dump().values() if isinstance(value, float)]).all()
        assert row.path_length_m > 0.05
        assert row.energy_j > 1.0
        assert row.collisions == 0  # the floor is no obstacle


@pytest.mark.parametrize("robot", ROBOTS)
def test_on_a_cpu_mujoco_is_chosen_for_it(bundles: dict[str, Path], robot: str):
    folder = bundles[ROBOTS[robot] * 64]
    assert choose_engine("auto", folder / "robot.xml", "plain", "cpu").engine == "mujoco"
