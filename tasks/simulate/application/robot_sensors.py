"""Cameras, IMUs and range finders of a robot's MJCF as declarations, by name, and what of them is not taken.

What a file does not say has the default of a declaration. Angles and places are those of the robot at rest.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.bundle_files import CameraDeclaration, RangeFindersDeclaration, facing, fitted_size
from tasks.simulate.application.robot_model import base_of, word_of

CAMERA, IMU, FINDER = "camera", "imu", "rangefinder"
_TILT = 1e-3
_IMU_NOISES = {
    mujoco.mjtSensor.mjSENS_GYRO: "gyro_sigma_rad_s",
    mujoco.mjtSensor.mjSENS_ACCELEROMETER: "force_sigma_m_s2",
}
_DIGITS = 6  # of a quarter turn, so many are no more than that
Fields = Mapping[str, float]


class FileSensors(NamedTuple):
    """What a robot's file has of sensors.

    Attributes:
        found: The fields of a declaration that each stands for, by kind and name.
        lines: What is not taken, and what has no effect unless a declaration asks for it, for a person.
    """

    found: Mapping[str, Mapping[str, Fields]]
    lines: tuple[str, ...]


class _NotTaken(Exception):  # noqa: N818 - a state
    """Why an element is no declaration."""


def file_sensors(spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData) -> FileSensors:
    """Returns the sensors of a robot's file.

    Args:
        spec: The file.
        model: As it is compiled.
        data: The robot at rest.
    """
    mujoco.mj_camlight(model, data)
    found: dict[str, dict[str, Fields]] = {CAMERA: {}, IMU: {}, FINDER: {}}
    lines: list[str] = []

    def take(kind: str, name: str, shown: str, fields: Callable[[], Fields], uses: str) -> None:
        try:
            found[kind][_required(name)] = fields()
            lines.append(f"{shown} has no effect unless {uses} says `mjcf: {name}`")
        except _NotTaken as why:
            lines.append(f"{shown} is not taken: {why}")

    for camera in spec.cameras:
        shown = f"camera {camera.name!r}{_line(camera)}"
        take(CAMERA, camera.name, shown, lambda k=camera.id: _camera(model, data, k), "a depth_camera or color_camera")
    others: dict[str, list[str]] = {}
    units: dict[int, list[Any]] = {}
    for sensor in spec.sensors:
        number = sensor.id
        kind, of_site = mujoco.mjtSensor(model.sensor_type[number]), model.sensor_objtype[number] == _SITE
        site = int(model.sensor_objid[number])
        if kind in _IMU_NOISES:
            units.setdefault(site, []).append(sensor)
        elif kind == mujoco.mjtSensor.mjSENS_RANGEFINDER and of_site:
            name = sensor.name or model.site(site).name
            shown = f"rangefinder {name!r}{_line(sensor)}"
            take(FINDER, name, shown, lambda k=number: _finder(model, data, k), "range_finders")
        else:
            others.setdefault(word_of(kind, "mjSENS_"), []).append(f"{sensor.name!r}{_line(sensor)}")
    for site, sensors in units.items():
        name, ids = model.site(site).name, [each.id for each in sensors]
        shown = " and ".join(f"<{word_of(each.type, 'mjSENS_')}>{_line(each)}" for each in sensors)
        take(IMU, name, f"imu of site {name!r}, {shown},", lambda s=site, k=ids: _imu(model, data, s, k), "an imu")
    for word, named in others.items():
        more = f" and {len(named) - 1} more" if len(named) > 1 else ""
        lines.append(f"<{word}> {named[0]}{more}: not taken: no sensor here tells that")
    return FileSensors(found, tuple(f"robot.xml: {line}" for line in lines))


_SITE = mujoco.mjtObj.mjOBJ_SITE


def _required(name: str) -> str:
    if not name:
        raise _NotTaken("nothing can ask for it: it has no name, nor has its site")
    return name


def _line(element: Any) -> str:  # noqa: ANN401 - any element of a specification
    return f" ({element.info})" if element.info else ""


def _require_fixed(model: mujoco.MjModel, body: int) -> None:
    if model.body_weldid[body] != model.body_weldid[base_of(model).body]:
        raise _NotTaken("it is not fixed to the base, but to what moves, or to the world")


def _rounded(fields: Mapping[str, Any]) -> Fields:
    return {name: round(float(value), _DIGITS) + 0.0 for name, value in fields.items()}


def _camera(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> Fields:
    _require_fixed(model, int(model.cam_bodyid[camera]))
    if model.cam_mode[camera] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        raise _NotTaken("its mode is not fixed")
    if model.cam_projection[camera] != mujoco.mjtProjection.mjPROJ_PERSPECTIVE:
        raise _NotTaken("it is orthographic")
    right, up, back = data.cam_xmat[camera].reshape(3, 3).T
    yaw, pitch = facing(-back, up)
    if abs(right[2]) > _TILT:
        raise _NotTaken(f"it is rolled by {math.asin(right[2]):.3g} rad; pictures here have a level horizon")
    if up @ (math.cos(yaw) * math.sin(pitch), math.sin(yaw) * math.sin(pitch), math.cos(pitch)) < 0.0:
        raise _NotTaken("it is upside down; pictures here have a level horizon")
    asked = tuple(int(side) for side in model.cam_resolution[camera])
    given = asked != (1, 1)  # which MuJoCo has where a file says nothing
    own = CameraDeclaration()
    columns, rows = fitted_size(*asked) if given else (own.columns, own.rows)
    ratio = asked[0] / asked[1] if given else columns / rows
    if model.cam_sensorsize[camera].any():
        across_m, high_m, (focal_x, focal_y, *off) = *model.cam_sensorsize[camera], model.cam_intrinsic[camera]
        if np.abs(off).max() > _TILT * across_m:
            raise _NotTaken("its principal point is not in its middle")
        if abs(focal_x / across_m * ratio - focal_y / high_m) > _TILT * focal_y / high_m:
            raise _NotTaken("its pixels are not square")
    fov = 2 * math.atan(ratio * math.tan(math.radians(float(model.cam_fovy[camera])) / 2))
    if not 0.01 <= fov <= 3.0:
        raise _NotTaken(f"it sees {fov:.3g} rad from left to right: 0.01 to 3 can be")
    x, y, z = data.cam_xpos[camera] - _floor_origin(model, data)
    if z < 0.0:
        raise _NotTaken("it is below the floor")
    fields = {"fov_rad": fov, "x_m": x, "y_m": y, "z_m": z, "pitch_rad": pitch, "yaw_rad": yaw}
    return {"columns": columns, "rows": rows, **_rounded(fields)}


def _floor_origin(model: mujoco.MjModel, data: mujoco.MjData) -> Float64[np.ndarray, "3"]:
    x, y, _ = data.xpos[base_of(model).body]
    return np.array([x, y, 0.0])


def _imu(model: mujoco.MjModel, data: mujoco.MjData, site: int, sensors: Sequence[int]) -> Fields:
    _require_fixed(model, int(model.site_bodyid[site]))
    base = base_of(model).body
    of_base = data.xmat[base].reshape(3, 3).T
    turn = of_base @ data.site_xmat[site].reshape(3, 3)
    if turn[2, 2] < 1.0 - _TILT**2:
        raise _NotTaken("its site is tilted; an IMU here is turned counter-clockwise alone")
    if any(model.sensor_cutoff[each] > 0.0 for each in sensors):
        raise _NotTaken("it has a cutoff, and an IMU here has none")
    x, y, z = of_base @ (data.site_xpos[site] - data.xpos[base])
    noises = {_IMU_NOISES[mujoco.mjtSensor(model.sensor_type[each])]: model.sensor_noise[each] for each in sensors}
    return _rounded({"x_m": x, "y_m": y, "z_m": z, "yaw_rad": math.atan2(turn[1, 0], turn[0, 0]), **noises})


def _finder(model: mujoco.MjModel, data: mujoco.MjData, sensor: int) -> Fields:
    site, own = int(model.sensor_objid[sensor]), RangeFindersDeclaration()
    _require_fixed(model, int(model.site_bodyid[site]))
    ahead = data.site_xmat[site].reshape(3, 3)[:, 2]
    if abs(ahead[2]) > _TILT:
        raise _NotTaken("its site's z axis, along which it looks, is not level")
    x, y, z = data.site_xpos[site] - _floor_origin(model, data)
    if abs(ahead[0] * y - ahead[1] * x) > 10 * _TILT:
        raise _NotTaken("it does not look away from the base's axis")
    if z < 0.0:
        raise _NotTaken("it is below the floor")
    range_m = float(model.sensor_cutoff[sensor]) or own.range_m
    first = math.atan2(ahead[1], ahead[0])
    out_m, sigma_m = ahead[0] * x + ahead[1] * y, model.sensor_noise[sensor]
    fields = {"range_m": range_m, "z_m": z, "first_rad": first, "out_m": out_m, "sigma_m": sigma_m}
    return {"finders": 1, "cone_rad": 0.01, **_rounded(fields)}


def finders_together(found: Iterable[Fields]) -> Fields | None:
    """Returns several range finders as one declaration; None if they are not as far apart from one to the next.

    Args:
        found: Of each, counter-clockwise.
    """
    first, *others = found
    angles = np.unwrap([first["first_rad"], *(each["first_rad"] for each in others)])
    apart = np.diff(angles)
    alike = all(
        abs(each[name] - first[name]) < 10 * _TILT for each in others for name in ("range_m", "z_m", "out_m", "sigma_m")
    )
    if not alike or np.ptp(apart) > 10 * _TILT:
        return None
    return {**first, "finders": 1 + len(others), "apart_rad": round(float(apart.mean()), _DIGITS)}
