"""What declared sensors of a robot would read, made of its lidar's ranges: cheap, and different at each place."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32

from specs.bundle_files import ColorCameraDeclaration
from specs.ros_robot import RosDepthCamera, RosImu, RosRangeFinders, RosRobot

_FAR_M = 8.0


def seeing(columns: int = 160, rows: int = 120) -> RosRobot:
    """Returns a robot with all that can be declared; pictures come each second and each third control step."""
    return RosRobot(
        depth_camera=RosDepthCamera(columns=columns, rows=rows, range_m=_FAR_M, rate_hz=10.0),
        color_camera=ColorCameraDeclaration(columns=columns, rows=rows, rate_hz=7.0, latency_steps=1),
        imu=RosImu(),
        range_finders=RosRangeFinders(finders=2, first_rad=0.5, apart_rad=-1.0, rate_hz=10.0),
    )


def with_two_eyes() -> RosRobot:
    """Returns a robot with two depth cameras, one ahead and one to the right."""
    eye = {"columns": 32, "rows": 24, "range_m": _FAR_M, "rate_hz": 10.0}
    eyes = [{"name": "ahead", **eye}, {"name": "right", "yaw_rad": -1.2, **eye}]
    return RosRobot.model_validate({"depth_camera": eyes})


def readings(robot: RosRobot, ranges_m: Float32[np.ndarray, "rays"]) -> Mapping[str, np.ndarray]:
    """Returns what a robot's sensors read; rays of its lidar begin behind it."""
    found: dict[str, np.ndarray] = {}
    first, step = -np.pi, 2 * np.pi / len(ranges_m)

    def ahead(angles: np.ndarray) -> np.ndarray:
        return ranges_m[np.rint((angles - first) / step).astype(int) % len(ranges_m)]

    for name, camera in (("depth_m", robot.depth_camera), ("color", robot.color_camera)):
        if camera is None:
            continue
        angles = camera.fov_rad * (0.5 - (np.arange(camera.columns) + 0.5) / camera.columns)
        yaws_rad = np.array([each.yaw_rad for each in camera.every])[:, None]
        depth_m = np.minimum(ahead(angles + yaws_rad) * np.cos(angles), _FAR_M).astype(np.float32)
        picture = np.broadcast_to(depth_m[:, None], (len(yaws_rad), camera.rows, camera.columns))
        picture = picture if len(yaws_rad) > 1 else picture[0]
        shades = (30 * picture).astype(np.uint8)
        found[name] = picture if name == "depth_m" else np.repeat(shades[..., None], 3, axis=2)
    if robot.range_finders is not None:
        finders = robot.range_finders
        found["finder_m"] = np.minimum(
            ahead(finders.first_rad + finders.apart_rad * np.arange(finders.finders)), finders.range_m
        )
    if robot.imu is not None:
        found |= {"turn_rad_s": ranges_m[:3] / 10, "force_m_s2": np.array([0.0, 0.0, 9.81], np.float32)}
    return found
