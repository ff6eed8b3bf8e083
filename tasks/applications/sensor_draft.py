"""What ``ros.yaml`` says of the sensors of a robot's description: lidar, cameras, IMU, and what of them is not taken.

Tags are those of SDFormat's specification of sensors, and of the public documentation of ``gazebo_plugins``, of ROS 1
and ROS 2, and of ``gz-sim``. A sensor looks along the x axis of its link, whatever frame its messages are in.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

from specs.bundle_files import ALIKE, MOST_CAMERAS, facing, fitted_size
from specs.data.episode import CONTROL_HZ, control_stride
from specs.ros_robot import RosFrames
from tasks.applications.robot_description import RobotDescription, Sensor, number, said

_LIDARS = ("ray", "gpu_ray", "lidar", "gpu_lidar")
# Cameras that tell depths as ROS has them tell colours, too, but for gz's own.
_DEPTHS, _COLORS = ("depth", "depth_camera", "rgbd_camera"), ("camera", "rgbd_camera", "depth")
_NEARLY_AROUND = 2 * math.pi - 0.1


class SensorDraft(NamedTuple):
    """What a declaration says of a robot's sensors.

    Attributes:
        topics, frames: By their names in ``ros.yaml``.
        sensors: The declarations, by theirs.
        taken: Elements that are in it, or that ``findings`` name.
        findings: What was not taken.
    """

    topics: dict[str, str | None]
    frames: dict[str, str]
    sensors: dict[str, Any]
    taken: list[Element]
    findings: list[str]


def draft_sensors(robot: RobotDescription, floor_m: float) -> SensorDraft:
    """Returns the sensors of a description.

    Args:
        robot: The description.
        floor_m: How high the floor is in its frame.
    """
    draft = SensorDraft({"scan": None, "imu": None, "bumper": None}, {}, {"lidar": None}, [], [])
    lidars = [each for each in _of_kinds(robot, _LIDARS) if "ros_range" not in library(each.element.find("plugin"))]
    if lidar := _first(lidars, "lidar", draft):
        _add_lidar(lidar, floor_m, draft)
    depths, colors = _of_kinds(robot, _DEPTHS), _of_kinds(robot, _COLORS)
    for name, cameras in (("depth", depths), ("color", colors)):
        if several := _together(cameras, name, floor_m):
            _add_together(several, cameras, f"{name}_camera", draft)
        elif camera := _first(cameras, f"{name} camera", draft):
            _add_camera(camera, name, floor_m, draft)
    _add_imu(robot, draft)
    seen: dict[str, str] = {}
    for name, topic in draft.topics.items():
        if topic and seen.setdefault(topic, name) != name:
            draft.topics[name] = None
            draft.findings.append(f"{name} would be {topic}, which {seen[topic]} is: it is left out")
    return draft


def shown(element: Element) -> str:
    """Returns an element's tag, as a person finds it."""
    named = "".join(f" {name}={element.get(name)!r}" for name in ("name", "type", "filename") if element.get(name))
    return f"<{element.tag}{named}>"[:160]


def library(plugin: Element | None) -> str:
    """Returns what tells of a plugin which one it is."""
    return "" if plugin is None else f"{plugin.get('filename', '')} {plugin.get('name', '')}"


def plugin_topic(plugin: Element | None, default: str, *names: str, remapped: str = "") -> str:
    """Returns a topic's full name: a plugin's tag, or what ROS 2 remaps it to, below its namespace."""
    return _full(plugin, _topic(plugin, default, *names, remapped=remapped))


def _topic(plugin: Element | None, default: str, *names: str, remapped: str) -> str:
    found = [
        (each.text or "").split(":=")[1].strip()
        for each in (plugin.iter("remapping") if plugin is not None else ())
        if (each.text or "").strip().startswith(f"{remapped}:=")
    ]
    return next(iter(found), "") or said(plugin, *names) or default


def _full(plugin: Element | None, name: str) -> str:
    space = said(plugin, "robotNamespace", "ros/namespace")
    return name if name.startswith("/") else f"/{space.strip('/')}/{name}".replace("//", "/")


def _of_kinds(robot: RobotDescription, kinds: Sequence[str]) -> list[Sensor]:
    """Returns the sensors of some kinds, those of the first kind first."""
    return [each for kind in kinds for each in robot.sensors if each.element.get("type") == kind]


def _first(sensors: Sequence[Sensor], what: str, draft: SensorDraft) -> Sensor | None:
    """Returns the sensor of a kind that is taken; names the others, but for those that are taken as another kind."""
    for each in sensors[1:]:
        if each.element not in draft.taken:
            draft.findings.append(f"{_named(each)}: a second {what} is not taken")
    draft.taken.extend(each.element for each in sensors)
    return sensors[0] if sensors else None


def _named(sensor: Sensor) -> str:
    return f"{shown(sensor.element)} of {sensor.link}"


def _rate(name: str, draft: SensorDraft, *elements: Element | None) -> Iterator[tuple[str, float]]:
    """Yields a sensor's rate, if it has one of its own; names one that cannot be."""
    tags = ("update_rate", "updateRate", "updateRateHZ")
    asked_hz = next((hz for each in elements if (hz := number(each, *tags)) > 0.0), 0.0)
    real_hz = CONTROL_HZ / control_stride(asked_hz)
    if asked_hz and abs(real_hz - asked_hz) > 0.01 * asked_hz:
        draft.findings.append(f"{name}: <update_rate> {asked_hz:g}: it is {real_hz:.4g}")
    if asked_hz and real_hz < CONTROL_HZ:
        yield "rate_hz", round(asked_hz, 4)


def _turned(sensor: Sensor) -> tuple[float, float]:
    """Returns how a sensor is turned: counter-clockwise, and down then."""
    return facing([*map(float, sensor.pose[:3, 0])])


def _add_lidar(sensor: Sensor, floor_m: float, draft: SensorDraft) -> None:
    element, plugin = sensor.element, sensor.element.find("plugin")
    ray = next((found for name in ("ray", "lidar") if (found := element.find(name)) is not None), element)
    across, reach = ray.find("scan/horizontal"), ray.find("range")
    first, last = number(across, "min_angle", default=-math.pi), number(across, "max_angle", default=math.pi)
    own = plugin if plugin is not None else element
    draft.topics["scan"] = plugin_topic(own, "/scan", "topicName", "topic", remapped="~/out")
    draft.frames["laser"] = said(plugin, "frameName", "frame_name") or said(element, "gz_frame_id") or sensor.link
    x, y, z = sensor.pose[:3, 3]
    fov = min(max(last - first, 1e-3), 2 * math.pi)
    # A scan all around has no middle: its frame is turned as its link is.
    middle = 0.0 if fov > _NEARLY_AROUND else (first + last) / 2
    if number(ray.find("scan/vertical"), "samples", default=1.0) > 1:
        draft.findings.append(f"{_named(sensor)}: <vertical>: one plane is taken, at its height")
    draft.sensors["lidar"] = {
        "rays": round(min(max(number(across, "samples", default=360.0), 1), 4096)),
        "range_m": round(number(reach, "max", default=8.0), 4),
        "height_m": round(max(0.0, float(z) - floor_m), 4),
        "fov_rad": 2 * math.pi if fov > _NEARLY_AROUND else round(fov, 5),
        "x_m": round(float(x), 4),
        "y_m": round(float(y), 4),
        "yaw_rad": round(_turned(sensor)[0] + middle, 5),
        "sigma_m": round(abs(number(ray.find("noise"), "stddev")), 5),
        "resolution_m": round(abs(number(reach, "resolution")), 5),
        **dict(_rate(_named(sensor), draft, element, plugin)),
    }


def _add_camera(sensor: Sensor, name: str, floor_m: float, draft: SensorDraft) -> None:
    element, plugin = sensor.element, sensor.element.find("plugin")
    found = element.find("camera")
    camera = element if found is None else found
    draft.topics.update(_camera_topics(element, plugin, name))
    frame = said(plugin, "frameName", "frame_name") or said(camera, "optical_frame_id") or said(element, "gz_frame_id")
    if frame:
        draft.frames[f"{name}_camera"] = frame
    asked = [max(1, round(number(camera, f"image/{side}", default=side_px))) for side, side_px in _SIZES]
    columns, rows = fitted_size(*asked)
    if [columns, rows] != asked:
        draft.findings.append(f"{_named(sensor)}: <image> {asked[0]} x {asked[1]}: {columns} x {rows} are taken")
    x, y, z = map(float, sensor.pose[:3, 3])
    yaw, pitch = _turned(sensor)
    far_m = number(camera, "clip/far", default=100.0)
    if name == "depth":
        far_m = min(far_m, number(plugin, "pointCloudCutoffMax", "max_depth", default=far_m))
    declared = {
        "columns": columns,
        "rows": rows,
        "fov_rad": round(min(max(number(camera, "horizontal_fov", default=1.047), 0.01), 3.0), 5),
        "range_m": round(min(max(far_m, 0.1), 1e4), 4),
        "x_m": round(x, 4),
        "y_m": round(y, 4),
        "z_m": round(max(0.0, z - floor_m), 4),
        "pitch_rad": min(max(round(pitch, 5), -math.pi / 2), math.pi / 2),
        "yaw_rad": round(yaw, 5),
        **dict(_rate(_named(sensor), draft, element, plugin)),
    }
    noise = abs(number(camera, "noise/stddev"))
    if noise and name == "color":
        declared["noise"] = round(min(noise, 1.0), 5)
    elif noise:
        draft.findings.append(f"{_named(sensor)}: <noise> is not taken: a depth errs with its square (sigma_m_per_m2)")
    draft.sensors[f"{name}_camera"] = declared


_NAMED = re.compile(r"/([a-z][a-z0-9_]{0,31})(/.+)")


def _together(cameras: Sequence[Sensor], name: str, floor_m: float) -> dict[str, SensorDraft]:
    """Returns drafts of some alike cameras by their names; nothing where they cannot be a list.

    They have pictures of one size at one time, and the same topics but for names of their own before them.
    """
    alone: dict[str, SensorDraft] = {}
    for camera in cameras:
        if camera.element.get("type") != cameras[0].element.get("type"):
            continue
        draft = SensorDraft({}, {}, {}, [camera.element], [])
        _add_camera(camera, name, floor_m, draft)
        parts = {key: _NAMED.fullmatch(topic) for key, topic in draft.topics.items() if topic}
        names = {found[1] if found else "" for found in parts.values()}
        if len(names) != 1 or "" in names or names <= alone.keys():
            return {}
        draft.topics.update({key: found[2] for key, found in parts.items() if found})
        alone[names.pop()] = draft
    first = next(iter(alone.values()), None)
    sensor = f"{name}_camera"
    same = [
        first is not None
        and each.topics == first.topics
        and all(each.sensors[sensor].get(key) == first.sensors[sensor].get(key) for key in ALIKE)
        for each in alone.values()
    ]
    return alone if 2 <= len(alone) <= MOST_CAMERAS and all(same) else {}


def _add_together(
    several: Mapping[str, SensorDraft], cameras: Sequence[Sensor], sensor: str, draft: SensorDraft
) -> None:
    drafts = [*several.values()]
    taken = [element for each in drafts for element in each.taken]
    draft.topics.update(drafts[0].topics)
    draft.sensors[sensor] = [{"name": name, **each.sensors[sensor]} for name, each in several.items()]
    draft.findings.extend(finding for each in drafts for finding in each.findings)
    ends = {each.frames.get(sensor, "").removeprefix(f"{name}_") for name, each in several.items()}
    if len(ends) == 1 and all(each.frames.get(sensor, "").startswith(f"{name}_") for name, each in several.items()):
        draft.frames[sensor] = ends.pop()
    else:
        frame = RosFrames.model_fields[sensor].default
        for name, each in several.items():
            if given := each.frames.get(sensor):
                draft.findings.append(f"{sensor} {name}: its frame is {name}_{frame}, not {given}")
    for each in cameras:
        if each.element not in taken and each.element not in draft.taken:
            draft.findings.append(f"{_named(each)}: another {sensor.replace('_', ' ')} is not taken")
    draft.taken.extend(each.element for each in cameras)


_SIZES = (("width", 320.0), ("height", 240.0))
# What a plugin calls a topic by itself, and the tags by which it is called otherwise.
_PLUGIN_TOPICS = {
    "color_image": ("image_raw", "imageTopicName"),
    "color_info": ("camera_info", "cameraInfoTopicName"),
    "depth_image": ("depth/image_raw", "depthImageTopicName"),
    "depth_info": ("depth/camera_info", "depthImageCameraInfoTopicName", "depthImageInfoTopicName"),
    "depth_points": ("points", "pointCloudTopicName"),
}


def _camera_topics(element: Element, plugin: Element | None, name: str) -> dict[str, str | None]:
    """Returns the topics of a camera: below its name where a plugin tells, as gz has them otherwise."""
    if plugin is not None:
        camera = said(plugin, "cameraName", "camera_name") or element.get("name", "camera")
        own = {key: _topic(plugin, last, *tags, remapped=last) for key, (last, *tags) in _PLUGIN_TOPICS.items()}
        names = {key: each if each.startswith("/") else f"{camera}/{each}" for key, each in own.items()}
        return {key: _full(plugin, each) for key, each in names.items() if key.startswith(name)}
    topic = said(element, "topic")
    if not topic:
        return {}
    topic = _full(None, topic)
    if element.get("type") == "rgbd_camera":
        info = {"color_info": f"{topic}/camera_info"} if name == "color" else {"depth_info": None}
        own = {"color_image": f"{topic}/image"} if name == "color" else {"depth_image": f"{topic}/depth_image"}
    else:
        own, info = {f"{name}_image": topic}, {f"{name}_info": f"{topic.rpartition('/')[0]}/camera_info"}
    points = {"depth_points": f"{topic}/points"} if name == "depth" else {}
    return {**own, **info, **points}


def _add_imu(robot: RobotDescription, draft: SensorDraft) -> None:
    """Adds the IMU, which knows where it faces, as Gazebo's does."""
    sensor = next(iter(_of_kinds(robot, ("imu",))), None)
    plugin = next((each for each in robot.plugins if "imu" in library(each)), None)
    if sensor is None and plugin is None:
        return
    element = sensor.element if sensor else None
    own = plugin if plugin is not None else element.find("plugin") if element is not None else None
    link = said(own, "bodyName") or (sensor.link if sensor else "")
    draft.topics["imu"] = plugin_topic(own, "/imu", "topicName", "topic", remapped="~/out")
    draft.frames["imu"] = said(own, "frameName", "frame_name") or link or "imu_link"
    draft.taken.extend(each for each in (element, plugin) if each is not None)
    pose = sensor.pose if sensor else robot.links.get(link)
    inner = element.find("imu") if element is not None else None
    written = element if element is not None else own
    name = shown(written) if written is not None else "imu"
    declared: dict[str, Any] = {"heading": True, **dict(_rate(name, draft, element, own))}
    if pose is not None:
        x, y, z = (round(float(each), 4) for each in pose[:3, 3])
        declared |= {"x_m": x, "y_m": y, "z_m": z, "yaw_rad": round(math.atan2(pose[1, 0], pose[0, 0]), 5)}
    for key, tags in _IMU_NOISES.items():
        if sigma := max(abs(number(inner, *tags)), abs(number(own, "gaussianNoise"))):
            declared[key] = round(sigma, 6)
    draft.sensors["imu"] = declared


_IMU_NOISES = {
    "gyro_sigma_rad_s": ("angular_velocity/x/noise/stddev", "noise/rate/stddev"),
    "force_sigma_m_s2": ("linear_acceleration/x/noise/stddev", "noise/accel/stddev"),
}
