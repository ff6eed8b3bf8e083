"""The folder of a chunk's nodes goes with the chunk, or with the next one if its process was killed."""

import errno
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import jax.numpy as jnp
import numpy as np
import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest
from specs.data.world import World
from specs.errors import StageFailed
from tasks.render.camera_pool import Shot
from tasks.render.gl_process import DrawingFailed
from tasks.ros.lockstep.exchange import Launch, RobotBase, Sensed, TwistCommand
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import HostMap, Observation, Placement
from tasks.simulate.geometry.world_arrays import WorldArrays
from tasks.simulate.host import color_cameras
from tasks.simulate.host.controllers import BlamesCrashes, HostBundle, HostStart, SeesWorlds
from tasks.simulate.host.ros_controllers import LockstepMaker, RosHome, RosLanes, remove_abandoned, ros_application
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.sensors.sensor_table import read_sensors
from tests.factories.simulations import BUNDLES, DRIFT, FOLDERS, delivery, pushing, simulate_lanes
from tests.ros.conftest import courier, wheel
from tests.simulate.host.fake_lockstep import (
    CANCELS,
    CRASHES,
    GIVES_UP,
    NOT_A_NUMBER,
    NOT_READY,
    ROS_ROBOT,
    STRAYS,
    TAGS,
    FakeLockstep,
    FakeLocksteps,
    ros_bundle,
)


@pytest.fixture(autouse=True)
def _temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def aged(path: Path) -> Path:
    os.utime(path, (0, 0))
    return path


def test_it_is_gone_with_all_that_lies_in_it():
    home = RosHome()
    (home.path / "log").mkdir()
    home.close()
    home.close()
    assert not home.path.exists()


def test_a_killed_processs_folder_is_removed_and_a_living_ones_kept(tmp_path: Path):
    living = RosHome()
    (living.path / "note").touch()
    aged(living.path)
    abandoned = tmp_path / "simyard-ros-abandoned"
    (abandoned / "log").mkdir(parents=True)
    aged(abandoned)
    remove_abandoned(tmp_path)
    assert living.path.exists()
    assert not abandoned.exists()
    living.close()


def test_a_folder_that_may_be_about_to_be_locked_is_kept(tmp_path: Path):
    (tmp_path / "simyard-ros-young").mkdir()
    remove_abandoned(tmp_path)
    assert (tmp_path / "simyard-ros-young").exists()


def test_what_is_no_such_folder_is_kept(tmp_path: Path):
    kept = tmp_path / "elsewhere"
    kept.mkdir()
    aged(kept)
    (tmp_path / "simyard-ros-link").symlink_to(kept)
    remove_abandoned(tmp_path)
    assert kept.exists()
    assert (tmp_path / "simyard-ros-link").is_symlink()


_FLOOR = HostMap(
    clearance_m=np.array([[0.0, 0.3, 0.0], [0.3, 0.2, 0.0]], np.float32),
    origin_m=np.array([1.0, 2.0], np.float32),
    cell_m=np.float32(0.5),  # pyright: ignore[reportArgumentType] - a scalar array
    bounds_m=np.zeros(4, np.float32),
)
_WIDTH = 8


def lane(index: int, kind: str) -> Lane:
    request = delivery(index, world="hand/one").model_copy(update={"environment": {"KIND": kind, "SPEED": "0.30"}})
    arrays = WorldArrays(*cast("Any", (None, None, _FLOOR, None, None, None)))  # the others are not used
    return Lane(request, arrays, Placement(np.zeros(3), np.zeros((1, 2))), None)


def started(
    folder: Path, kinds: list[str], make: LockstepMaker | None = None, declaration: str = "lidar: {rays: 4}"
) -> tuple[RosLanes, FakeLocksteps]:
    locksteps = FakeLocksteps()
    bundle = HostBundle(ros_bundle(folder / "bundle", declaration), ROS_ROBOT)
    application = ros_application(bundle, "ros", make or locksteps)
    lanes = [lane(index, kind) for index, kind in enumerate(kinds)]
    worlds: Any = {"hand/one": Undrawn()}
    start = HostStart(lanes, _WIDTH, 3, read_sensors(application.declare, {}), worlds)
    made = application.start(start)
    assert isinstance(made, RosLanes)
    return made, locksteps


def observed(
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0), velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Observation:
    each = {
        "pose": pose,
        "velocity": velocity,
        "ranges_m": (1.0, 3.0, 2.0, 1.0),
        "goal_m": (4.0, 5.0),
        "goal_robot_m": (4.0, 5.0),
        "bumper": (),
    }
    fields = {name: np.tile(np.asarray(value, np.float32), (_WIDTH, 1)) for name, value in each.items()}
    zeros = np.zeros(_WIDTH, np.float32)
    return Observation(time_s=zeros, goal_index=zeros, **fields)  # pyright: ignore[reportArgumentType] - NumPy's


def moving(*lanes: int) -> np.ndarray:
    return np.isin(np.arange(_WIDTH), lanes)


def driven(lanes: RosLanes, steps: int, *numbers: int) -> np.ndarray:
    controls = np.zeros(0)
    for _ in range(steps):
        controls = lanes.controls(observed(), moving(*numbers))
    return controls


def only(locksteps: FakeLocksteps) -> FakeLockstep:
    (made,) = locksteps.made
    return made


def sensed(lockstep: FakeLockstep, step: int = -1, number: int = 0) -> Sensed:
    found = lockstep.seen[step][number]
    assert found is not None
    return found


def test_nothing_is_started_before_the_first_control_step(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [""])
    lanes.close()
    assert not locksteps.made


def test_a_lane_is_driven_by_its_own_command(tmp_path: Path):
    lanes, _ = started(tmp_path, ["", ""])
    controls = driven(lanes, 1, 0, 1)
    assert controls.shape == (_WIDTH, 3)
    np.testing.assert_allclose(controls[:2], [[0.3, 1.0, 0.0]] * 2, atol=1e-6)
    assert not controls[2:].any()


def test_nodes_get_the_variables_of_their_lane_as_texts(tmp_path: Path):
    lanes, locksteps = started(tmp_path, ["a", "b"])
    driven(lanes, 1, 0, 1)
    launch = only(locksteps).launch
    assert list(launch.environment) == [{"KIND": "a", "SPEED": "0.30"}, {"KIND": "b", "SPEED": "0.30"}]
    assert (launch.package, launch.launch_file) == ("patrol", "drive.launch")


def test_velocity_and_acceleration_are_those_of_the_robots_own_frame(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [""])
    lanes.controls(observed(pose=(1.0, 2.0, np.pi / 2)), moving(0))
    lanes.controls(observed(pose=(1.0, 2.0, np.pi / 2), velocity=(0.1, 0.4, 0.2)), moving(0))
    np.testing.assert_allclose(sensed(only(locksteps), 0).acceleration, (0.0, 0.0))
    np.testing.assert_allclose(sensed(only(locksteps)).velocity, (0.4, -0.1, 0.2), atol=1e-6)
    np.testing.assert_allclose(sensed(only(locksteps)).acceleration, (8.0, -2.0), atol=1e-5)
    np.testing.assert_allclose(sensed(only(locksteps)).goal, (4.0, 5.0))


_SEES = "depth_camera: {columns: 3, rows: 2}\nimu: {yaw_rad: 1}\nrange_finders: {finders: 2}\nlidar: {rays: 4}"


def test_nodes_are_told_what_declared_sensors_read(tmp_path: Path):
    lanes, locksteps = started(tmp_path, ["", ""], declaration=_SEES)
    depth_m = np.arange(_WIDTH * 6, dtype=np.float32).reshape(_WIDTH, 2, 3)
    turns = np.arange(_WIDTH * 3, dtype=np.float32).reshape(_WIDTH, 3)
    fields = observed()._replace(depth_m=depth_m, turn_rad_s=turns, force_m_s2=turns + 9, finder_m=turns[:, :2])  # pyright: ignore[reportArgumentType] - NumPy's
    lanes.controls(fields, moving(0, 1))
    told = sensed(only(locksteps), number=1).readings
    assert told.keys() == {"depth_m", "turn_rad_s", "force_m_s2", "finder_m"}
    np.testing.assert_array_equal(told["depth_m"], depth_m[1])
    np.testing.assert_array_equal(told["finder_m"], [3.0, 4.0])


def test_a_sensor_that_no_topic_tells_of_is_not_simulated(tmp_path: Path):
    none = "topics: {depth_image: null, depth_points: null, imu: null, range_finders: null}"
    folder = ros_bundle(tmp_path, f"{_SEES}\n{none}")
    declared = ros_application(HostBundle(folder, ROS_ROBOT), "ros", FakeLocksteps()).declare
    found = read_sensors(declared, {})
    assert (found.depth_camera, found.imu, found.range_finders, found.lidar.rays) == (None, None, None, 4)


class Undrawn:
    """Stands for a world that nobody draws."""

    def model_dump_json(self) -> str:
        return "{}"


class _Drawer:
    """Stands for the processes that draw: a picture has its number, from 1, in all pixels; the third one fails."""

    gl = "none"

    def __init__(self) -> None:
        self.drawn: list[int] = []

    def add(self, key: str, world: World, camera: object, robot: object) -> None:
        pass

    def color(self, shots: Sequence[Shot]) -> np.ndarray:
        self.drawn.append(shots[0].number)
        if shots[0].number == 2:
            raise DrawingFailed("the GL is gone")
        return np.stack([np.full((2, 3, 3), shot.number + 1, np.uint8) for shot in shots])


class _Watching(FakeLockstep):
    """Reads at each control step what lane 1 sees."""

    def __init__(self, base: RobotBase, launch: Launch) -> None:
        super().__init__(base, launch)
        self.colors: list[int] = []

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        if sensed[1] is not None:
            self.colors.append(int(sensed[1].readings["color"].max()))
        return super().exchange(sensed)


def seeing(folder: Path, make: LockstepMaker, monkeypatch: pytest.MonkeyPatch, steps: int) -> tuple[RosLanes, _Drawer]:
    drawer = _Drawer()
    monkeypatch.setattr(color_cameras, "standing_cameras", lambda most: drawer if most == 2 else None)
    declaration = "color_camera: {columns: 3, rows: 2, rate_hz: 10, latency_steps: 1}\nlidar: {rays: 4}"
    lanes, _ = started(folder, ["", ""], make, declaration)
    assert isinstance(lanes, SeesWorlds)
    lanes.see(np.zeros((_WIDTH, 3), np.float32))
    driven(lanes, steps, 0, 1)
    return lanes, drawer


def test_nodes_see_colours_until_nothing_can_be_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made: list[_Watching] = []

    def make(base: RobotBase, launch: Launch) -> _Watching:
        made.append(_Watching(base, launch))
        return made[-1]

    lanes, drawer = seeing(tmp_path, make, monkeypatch, 5)
    assert (made[0].colors, drawer.drawn) == ([0, 1, 1, 2, 2], [0, 1])
    assert np.isnan(driven(lanes, 1, 0, 1)[:2]).all()
    assert set(lanes.crashes.values()) == {"wheels: the GL is gone"}
    assert isinstance(lanes, BlamesCrashes)
    assert {lanes.failure_code(lane) for lane in lanes.crashes} == {"InternalServiceError"}
    assert isinstance(lanes, SeesWorlds)
    assert (lanes.gl, lanes.first_camera()) == ("none", None), "a replay does not ask for what cannot be drawn"
    lanes.close()
    assert made[0].closed == 1


def test_colours_that_no_node_asks_for_are_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    lanes, drawer = seeing(tmp_path, FakeLocksteps(), monkeypatch, 6)
    assert (lanes.crashes, drawer.drawn) == ({}, [])
    lanes.close()


def test_the_first_ray_and_the_step_to_the_next_are_told(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [""], declaration="lidar: {rays: 4, fov_rad: 3.0, range_m: 6}")
    driven(lanes, 1, 0)
    base = only(locksteps).base
    assert (base.rays, base.range_m) == (4, 6.0)
    np.testing.assert_allclose((base.first_ray_rad, base.ray_step_rad), (-1.5, 1.0))


def test_a_map_is_told_where_it_is_declared_and_shows_what_reaches_into_a_cell(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [""], declaration="lidar: {rays: 4}\ntopics: {floor_map: /map}")
    driven(lanes, 1, 0)
    begun = only(locksteps).begun
    assert begun is not None
    plan = begun[1][0]
    assert plan is not None
    np.testing.assert_array_equal(plan.cells, [[100, 0, 100], [0, 100, 100]])
    assert (plan.origin_m, plan.cell_m) == ((0.75, 1.75), 0.5)


def test_no_map_is_told_where_none_is_declared(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [""])
    driven(lanes, 1, 0)
    begun = only(locksteps).begun
    assert begun is not None
    assert begun[1] == [None]


def test_lanes_that_are_done_are_asked_nothing_more(tmp_path: Path):
    lanes, locksteps = started(tmp_path, ["", ""])
    driven(lanes, 1, 0, 1)
    driven(lanes, 1, 1)
    assert [each is None for each in only(locksteps).seen[-1]] == [True, False]


@pytest.mark.parametrize(
    ("kind", "steps", "why"),
    [
        (CRASHES, 3, "wheels: node /patrol ended with status 7"),
        (NOT_READY, 1, "wheels: node /patrol was not ready within 60 s"),
        (NOT_A_NUMBER, 3, "wheels: /cmd_vel: a Twist that is not finite: linear.x nan, linear.y 0.0, angular.z 0.0"),
    ],
)
def test_a_lane_whose_application_fails_crashes_alone(tmp_path: Path, kind: str, steps: int, why: str):
    lanes, locksteps = started(tmp_path, ["", kind])
    controls = driven(lanes, steps, 0, 1)
    assert np.isfinite(controls[0]).all()
    assert np.isnan(controls[1]).all()
    assert lanes.crashes == {1: why}
    assert np.isnan(driven(lanes, 1, 0, 1)[1]).all()
    assert only(locksteps).seen[-1][1] is None


def test_a_lane_that_cancels_its_job_is_no_crash(tmp_path: Path):
    lanes, _ = started(tmp_path, [CANCELS, ""])
    assert np.isnan(driven(lanes, 3, 0, 1)[0]).all()
    assert (lanes.cancelled, lanes.crashes) == (frozenset({0}), {})


def test_a_goal_that_is_given_up_ends_its_lane_and_says_why(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [GIVES_UP, ""])
    assert np.isnan(driven(lanes, 3, 0, 1)[0]).all()
    assert (lanes.crashes, lanes.judgement(1)) == ({}, None)
    judgement = lanes.judgement(0)
    assert judgement is not None
    assert (judgement.passed, judgement.reason, judgement.tags) == (False, "aborted", {"navigation_error_code": "9002"})
    driven(lanes, 1, 0, 1)
    assert only(locksteps).seen[-1][0] is None


@pytest.mark.parametrize(
    ("declaration", "why"),
    [
        ("goals: navigate_to_pose", "goals: navigate_to_pose: not of this ROS, whose action is move_base"),
        ("record: {/plan: nav_msgs/Path}", "record: nodes of ROS 2 alone are recorded: leave it out"),
    ],
)
def test_what_is_ros_2s_alone_is_refused_for_ros_1(tmp_path: Path, declaration: str, why: str):
    bundle = HostBundle(ros_bundle(tmp_path / "bundle", declaration), ROS_ROBOT)
    with pytest.raises(BundleCrash, match=f"ros.yaml: {why}"):
        ros_application(bundle, "ros", FakeLocksteps())


def test_a_type_that_nobody_knows_is_not_recorded(tmp_path: Path):
    bundle = HostBundle(ros_bundle(tmp_path / "bundle", "record: {/plan: my_msgs/Plan}"), ROS_ROBOT)
    with pytest.raises(
        BundleCrash, match=r"ros.yaml: record./plan: my_msgs/Plan: no type of ROS 2's common interfaces"
    ):
        ros_application(bundle, "ros2", FakeLocksteps())


def test_measures_and_tags_outlive_the_applications(tmp_path: Path):
    lanes, _ = started(tmp_path, [STRAYS, TAGS])
    driven(lanes, 3, 0, 1)

    def told() -> list[object]:
        return [(lanes.measures(number), lanes.metrics(number), lanes.tags(number)) for number in range(2)]

    before = told()
    lanes.close()
    strays = ({"late": 2, "stray": 1}, {"navigation_recoveries": 4.0}, {})
    assert before == [strays, ({"late": 0, "stray": 0}, {}, {"lane": "1", "seen": "much"})]
    assert told() == before


def test_closing_twice_ends_the_applications_once_and_leaves_no_file(tmp_path: Path):
    lanes, locksteps = started(tmp_path, [""])
    driven(lanes, 1, 0)
    home = only(locksteps).launch.home
    assert home.is_dir()
    lanes.close()
    lanes.close()
    assert only(locksteps).closed == 1
    assert not home.exists()


def test_what_nodes_printed_is_told_of_lanes_that_failed_before_the_first_step_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    lanes, _ = started(tmp_path, [NOT_READY, ""])
    driven(lanes, 1, 0, 1)
    lanes.close()
    assert capsys.readouterr().out == "job 0 of wheels:\npatrol: no map\n"


class _Refusing(FakeLockstep):
    def begin(self, sensed: object, floors: object) -> None:  # noqa: ARG002 - as lock-steps begin
        raise StageFailed("InternalServiceError", "no ROS here")


class _Crowded(FakeLockstep):
    def exchange(self, sensed: object) -> list[TwistCommand]:  # noqa: ARG002 - as they exchange
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")


def test_applications_that_cannot_be_launched_are_the_crash_of_all_lanes(tmp_path: Path):
    made: list[FakeLockstep] = []

    def make(base: object, launch: Launch) -> FakeLockstep:
        made.append(_Refusing(base, launch))  # pyright: ignore[reportArgumentType] - a Base
        return made[-1]

    lanes, _ = started(tmp_path, ["", ""], make)
    assert np.isnan(driven(lanes, 1, 0, 1)[:2]).all()
    assert set(lanes.crashes.values()) == {"wheels: InternalServiceError: no ROS here"}
    lanes.close()
    assert made[0].closed == 1


def test_a_machine_without_room_for_more_processes_is_out_of_memory(tmp_path: Path):
    lanes, _ = started(tmp_path, [""], _Crowded)
    with pytest.raises(MemoryError, match="a control step of 1 ROS applications"):
        driven(lanes, 1, 0)


def test_the_observation_may_be_jaxs(tmp_path: Path):
    lanes, _ = started(tmp_path, [""])
    seen = observed()
    lanes.controls(seen._replace(pose=jnp.asarray(seen.pose)), moving(0))
    assert not lanes.crashes


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
