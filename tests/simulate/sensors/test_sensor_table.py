"""What a controller declares is read, and refused with all its faults."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, get_args

import jax
import jax.numpy as jnp
import pytest

from specs.bundle_files import SensorDeclarations
from specs.data.episode import control_stride
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import Body, Motion, Work
from tasks.simulate.sensors.bumper import Bumper
from tasks.simulate.sensors.lidar import NO_LIDAR, Lidar
from tasks.simulate.sensors.odometry import Odometry
from tasks.simulate.sensors.sensor import Drive, Sensor, Situation, seed_words
from tasks.simulate.sensors.sensor_table import (
    SENSORS,
    Sensors,
    begin_sensors,
    feel_all,
    observe_all,
    read_color_camera,
    read_sensors,
    require_shared,
)

Declared = Mapping[str, object]
LIDAR: Declared = {"rays": 16, "range_m": 8.0, "height_m": 0.2}


def robot(**sensors: Declared) -> Callable[[Mapping[str, object]], SimpleNamespace]:
    declared = {name: SimpleNamespace(**values) for name, values in sensors.items()}
    return lambda _: SimpleNamespace(**declared)


def read(**sensors: Declared) -> Sensors:
    return read_sensors(robot(**sensors), {})


def test_what_is_left_out_has_its_default():
    assert read(lidar=LIDAR) == Sensors(Lidar(16, 8.0, 0.2), None, Bumper(0))


def test_a_robot_may_have_no_sensors():
    assert read() == Sensors(NO_LIDAR, None, Bumper(0))


def test_all_that_is_declared_is_read():
    lidar = {**LIDAR, "fov_rad": 3.0, "x_m": 0.1, "sigma_m": 0.01, "dropout": 0.05, "resolution_m": 0.02}
    found = read(lidar=lidar, odometry={"sigma_rad_per_m": 0.01}, bumper={"sectors": 6})
    assert found.lidar._asdict().items() >= lidar.items()
    assert found.odometry == Odometry(sigma_rad_per_m=0.01)
    assert found.bumper == Bumper(6)


def test_numbers_from_the_environment_are_read_as_plain_ones():
    found = read_sensors(
        lambda environment: SimpleNamespace(odometry=SimpleNamespace(sigma_m_per_m=environment["D"])),
        {"D": jnp.float32(0.5)},
    )
    assert found.odometry == Odometry(sigma_m_per_m=0.5)


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ({"lidar": {"rays": 16, "range_m": 8.0}}, "controller.lidar.height_m: missing: must be a number from 0"),
        ({"lidar": {**LIDAR, "rays": 2.5}}, "controller.lidar.rays: 2.5: must be a whole number from 1 to 4096"),
        ({"lidar": {**LIDAR, "rays": 0}}, "controller.lidar.rays: 0: must be"),
        ({"lidar": {**LIDAR, "range_m": float("inf")}}, "controller.lidar.range_m: inf: must be a number"),
        ({"lidar": {**LIDAR, "sigma_m": -0.1}}, "controller.lidar.sigma_m: -0.1: must be a number from 0"),
        ({"lidar": {**LIDAR, "sigma_m": "0.1"}}, "controller.lidar.sigma_m: '0.1': must be a number"),
        ({"lidar": {**LIDAR, "sigma_m": jnp.ones(3)}}, "controller.lidar.sigma_m"),
        ({"lidar": {**LIDAR, "dropout": 1.5}}, "controller.lidar.dropout: 1.5: must be a number from 0 to 1"),
        ({"lidar": {**LIDAR, "fov_rad": 7.0}}, "controller.lidar.fov_rad: 7.0: must be a number from 0.001 to 6.28"),
        ({"odometry": {"sigma_rad_per_m": -1.0}}, "controller.odometry.sigma_rad_per_m: -1.0"),
        ({"bumper": {}}, "controller.bumper.sectors: missing"),
        ({"bumper": {"sectors": 0}}, "controller.bumper.sectors: 0: must be a whole number from 1 to 360"),
    ],
)
def test_what_cannot_be_is_refused_with_its_name_and_what_is_allowed(sensors: dict[str, Declared], message: str):
    with pytest.raises(BundleCrash, match="RobotApplicationCrash: controller") as caught:
        read(**sensors)
    assert message in caught.value.reason


def test_a_list_of_sensors_is_refused_with_where_to_read_what_to_do_instead():
    twice = [SimpleNamespace(**LIDAR)] * 2
    with pytest.raises(BundleCrash, match=r"controller\.lidar: a robot has one .*; controller\.imu: a robot"):
        read_sensors(lambda _: SimpleNamespace(lidar=twice, imu=tuple(twice), bumper=Bumper(3)), {})


CAMERA: Declared = {"columns": 8, "rows": 4, "fov_rad": 1.0, "range_m": 5.0, "z_m": 0.3}


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ([{"name": "front"}], "1 in a list of cameras"),
        ([{"name": "front"}, {}], "each camera of a list has one of its own"),
        ([{"name": "front"}, {"name": "front"}], "each camera of a list has one of its own"),
        ([{"name": "front"}, {"name": "rear", "rows": 5}], "rows: cameras of a list have the same"),
        ([{"name": "front"}, {"name": "rear", "rate_hz": 5.0}], "rate_hz: cameras of a list have the same"),
    ],
)
def test_a_list_of_cameras_has_names_and_pictures_of_one_size(cameras: list[Declared], message: str):
    made = [SimpleNamespace(**{**CAMERA, **each}) for each in cameras]
    with pytest.raises(BundleCrash, match=f"controller.depth_camera: .*{message}"):
        read_sensors(lambda _: SimpleNamespace(depth_camera=made), {})
    with pytest.raises(BundleCrash, match=f"controller.color_camera: .*{message}"):
        read_color_camera(lambda _: SimpleNamespace(color_camera=made), {})


def test_cameras_of_a_list_are_read_as_one_and_the_others_behind_it():
    made = [SimpleNamespace(**CAMERA, name="front"), SimpleNamespace(**CAMERA, name="rear", yaw_rad=3.0)]
    depth = read_sensors(lambda _: SimpleNamespace(depth_camera=made), {}).depth_camera
    color = read_color_camera(lambda _: SimpleNamespace(color_camera=made), {})
    assert depth
    assert color
    for each in (depth, color):
        assert [(one.name, one.yaw_rad) for one in each.every] == [("front", 0.0), ("rear", 3.0)]
        assert each.shape == (2, 4, 8)


def test_all_faults_are_told_at_once():
    with pytest.raises(BundleCrash) as caught:
        read(lidar={"rays": 0, "range_m": -1.0, "height_m": 0.2}, bumper={"sectors": 1000})
    assert caught.value.reason.count("must be") == 3


@pytest.mark.parametrize(
    ("other", "name"),
    [
        (Sensors(Lidar(32, 8.0, 0.2), None, Bumper(4)), "lidar.rays: 32 in this episode, 16 in its program"),
        (Sensors(Lidar(16, 8.0, 0.3), None, Bumper(4)), "lidar.height_m"),
        (Sensors(Lidar(16, 8.0, 0.2), None, Bumper(8)), "bumper.sectors: 8"),
        (Sensors(Lidar(16, 8.0, 0.2), Odometry(), Bumper(4)), "odometry: True"),
    ],
)
def test_what_decides_shapes_must_be_the_same_in_a_program(other: Sensors, name: str):
    with pytest.raises(BundleCrash) as caught:
        require_shared(Sensors(Lidar(16, 8.0, 0.2), None, Bumper(4)), other)
    assert caught.value.reason.startswith(f"controller.{name}")


def test_noise_may_differ_between_the_episodes_of_a_program():
    one, other = (Sensors(Lidar(16, 8.0, 0.2, sigma_m=sigma), None, Bumper(0)) for sigma in (0.0, 0.1))
    require_shared(one, other)


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)
def test_a_file_declares_a_sensor_as_a_controller_does(sensor: Sensor[Any]):
    form, _ = get_args(SensorDeclarations.model_fields[sensor.name].annotation)
    assert set(form.model_fields) == set(sensor.kind._fields)
    made = read_sensors(lambda _: SimpleNamespace(**{sensor.name: form()}), {})
    assert getattr(made, sensor.name) == sensor.kind(**form().model_dump())


@pytest.mark.parametrize("pace", [(10.0, 3), (0.0, 2), (7.0, 0)], ids=str)
def test_a_reading_is_as_old_as_declared_and_stays_until_the_next_is_due(pace: tuple[float, int]):
    rate_hz, late = pace
    sensors = read(gps={"rate_hz": rate_hz, "latency_steps": late}, compass={"latency_steps": 1})
    none: Any = None
    still = Body(jnp.zeros(3), jnp.zeros(3), none, none)

    def at(step: Any) -> Situation:  # noqa: ANN401 - a number or an array
        pose = jnp.zeros(3).at[0].set(step)
        return Situation(still._replace(qpos=pose), none, jnp.asarray(seed_words(1)), jnp.asarray(step, jnp.int32))

    def advance(memories: Any, step: Any) -> tuple[Any, Any]:  # noqa: ANN401 - pytrees
        seen = observe_all(sensors, sensors, memories, at(step))["gps_m"][0]
        drive = Drive(at(step), Motion(at(step + 1).body, Work(none, jnp.zeros(2), none), none))
        return feel_all(sensors, sensors, memories, drive), seen

    begun = begin_sensors(sensors, sensors, at(0))
    seen = jax.jit(lambda begun: jax.lax.scan(advance, begun, jnp.arange(12))[1])(begun)
    stride = control_stride(rate_hz)
    assert seen.tolist() == [max(step - late, 0) // stride * stride for step in range(12)]


def test_a_pace_decides_what_a_program_keeps_and_follows_from_no_number():
    with pytest.raises(BundleCrash, match=r"controller.gps.latency_steps: 0.5: must be a whole number from 0 to 20"):
        read(gps={"latency_steps": 0.5})
    with pytest.raises(BundleCrash, match=r"controller.imu.rate_hz: 0.0 in this episode, 5.0 in its program"):
        require_shared(read(imu={"rate_hz": 5}), read(imu={}))


def test_every_sensor_has_its_place_and_noises_of_its_own():
    assert tuple(sensor.name for sensor in SENSORS) == Sensors._fields
    streams = [stream for sensor in SENSORS for stream in sensor.streams]
    assert len(set(streams)) == len(streams)
