"""A draft of ``robot.xml`` and ``ros.yaml``, made of a robot's description with Gazebo's plugins.

The robot becomes a planar base, which every engine takes: upright cylinders are its hull, and actuators push where its
wheels touch the floor, at the speeds that the plugin's kinematics give them. Wheels and casters weigh and are part of
the hull; they do not turn. What is not taken is named with its tag.

Run as ``python -m tasks.applications.robot_draft``, shut in, with a ``DraftRequest`` as its input; the last line that
it prints is a ``RobotDraft``. Plugins' tags are those of the public documentation of ``gazebo_plugins`` and ``gz-sim``.
"""

import itertools
import math
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element
from xml.sax.saxutils import quoteattr

import numpy as np
import shapely
import trimesh
import yaml
from numpy.typing import NDArray
from pydantic import ValidationError

from specs.errors import LaunchRefused
from specs.ros_robot import DraftRequest, RobotDraft, RosRobot
from tasks.applications.robot_description import (
    Joint,
    RobotDescription,
    Shape,
    number,
    read_description,
    said,
)
from tasks.applications.sensor_draft import SensorDraft, draft_sensors, library, plugin_topic, shown
from tasks.ros.launch.packages import bundle_packages

_GRAVITY = 9.81
_STEP_S = 0.005
# How long a base takes to come near to what it is told: wheels that roll let it slip neither ahead nor sideways.
_ANSWER_S = 0.01
# Without a limit of the wheels' speed.
_FASTEST_M_S, _FASTEST_RAD_S = 3.0, 6.0
_ROUND = 0.85
_CELLS = 4
_ABOVE_FLOOR_M = 0.01
_CORNERS = 24
_MOST_MESH_BYTES = 64 << 20
_DRIVES = ("skid_steer_drive", "diff_drive", "diff-drive", "DiffDrive", "planar_move", "planar-move", "VelocityControl")


class _Drive(NamedTuple):
    """How the base is driven.

    Attributes:
        kind: ``differential`` or ``planar``.
        plugin: The plugin, as it is written.
        axle_m: Where the axle is, ahead of the robot's origin.
        track_m: Between the wheels of both sides.
        push_n: What the wheels of a side push with at most.
        speed_m_s: How fast they roll at most.
    """

    kind: str
    plugin: Element
    axle_m: float = 0.0
    track_m: float = 0.0
    push_n: float = 0.0
    speed_m_s: float = _FASTEST_M_S


class _Body(NamedTuple):
    """The base as one body, on the floor.

    Attributes:
        mass_kg, center_m, izz_kgm2: Of all links together, the inertia about an upright axis through the centre.
        discs: x, y and radius of the upright cylinders that are its hull.
        low_m, high_m: Where the hull begins and ends above the floor.
        floor_m: How high the floor is in the robot's frame.
    """

    mass_kg: float
    center_m: NDArray[np.float64]
    izz_kgm2: float
    discs: Sequence[tuple[float, float, float]]
    low_m: float
    high_m: float
    floor_m: float


def draft_robot(request: DraftRequest) -> RobotDraft:
    """Returns the draft of a robot's files.

    Raises:
        LaunchRefused: Its description is none, or no plugin of it drives a base.
    """
    robot = read_description(request.description)
    findings: list[str] = []
    drive = _drive(robot, findings)
    body = _body(robot, request, findings)
    declared = _declaration(robot, drive, body, findings)
    findings += _not_taken(robot, drive)
    return RobotDraft(
        robot_xml=_robot_xml(robot, drive, body),
        ros_yaml=f"# A draft, made of the description of {_plain(robot.name)}.\n{_yaml(declared)}",
        findings=(*dict.fromkeys(findings),),
    )


# The drive.


def _drive(robot: RobotDescription, findings: list[str]) -> _Drive:
    plugin = next((each for each in robot.plugins if any(name in library(each) for name in _DRIVES)), None)
    if plugin is None:
        have = ", ".join(map(shown, robot.plugins)) or "none at all"
        raise LaunchRefused(
            f"no plugin of the robot's description drives a base (diff_drive, skid_steer_drive or planar_move; it has "
            f"{have}): write robot.xml yourself, as docs/guide/robots.md shows"
        )
    if any(name in library(plugin) for name in ("planar_move", "planar-move", "VelocityControl")):
        return _Drive("planar", plugin)
    if "skid_steer" in library(plugin):
        findings.append(
            f"{shown(plugin)}: the draft does not slip when it turns; widen track_m until it turns as it does"
        )
    sides = [_wheels(robot, plugin, side) for side in ("left", "right")]
    wheels = [joint for side in sides for joint in side]
    span_m = (
        abs(float(np.mean([j.pose[1, 3] for j in sides[0]]) - np.mean([j.pose[1, 3] for j in sides[1]])))
        if all(sides)
        else 0.0
    )
    track_m = number(plugin, "wheelSeparation", "wheel_separation", default=span_m)
    diameter_m = number(plugin, "wheelDiameter", "wheel_diameter", default=2 * number(plugin, "wheel_radius"))
    torque_nm = number(plugin, "wheelTorque", "torque", "max_wheel_torque")
    if track_m <= 0.0 or diameter_m <= 0.0:
        raise LaunchRefused(
            f"{shown(plugin)}: wheelSeparation {track_m:g} and wheelDiameter {diameter_m:g} are lengths above 0"
        )
    limits = [joint.limit_rad_s for joint in wheels if joint.limit_rad_s > 0.0]
    return _Drive(
        "differential",
        plugin,
        axle_m=float(np.mean([joint.pose[0, 3] for joint in wheels])) if wheels else 0.0,
        track_m=track_m,
        push_n=2.0 * torque_nm / diameter_m * max(1, len(sides[0])),
        speed_m_s=min([_FASTEST_M_S, *(limit * diameter_m / 2 for limit in limits)]),
    )


def _wheels(robot: RobotDescription, plugin: Element, side: str) -> list[Joint]:
    """Returns the joints of the wheels of a side: ``leftJoint``, ``leftRearJoint``, ``left_joint`` and their like."""
    named = [(each.text or "").strip() for each in plugin if re.fullmatch(rf"{side}\w*[jJ]oint", each.tag)]
    return [robot.joints[name] for name in named if name in robot.joints]


# The body.


def _body(robot: RobotDescription, request: DraftRequest, findings: list[str]) -> _Body:
    points = [_points(shape, request, findings) for shape in robot.shapes]
    touched = np.concatenate([np.zeros((0, 3)), *points])
    if not len(touched):
        raise LaunchRefused("no link of the robot's description has a collision: nothing of it could touch anything")
    floor_m, top_m = round(float(touched[:, 2].min()), 6), round(float(touched[:, 2].max()), 6)
    low_m = min(_ABOVE_FLOOR_M, (top_m - floor_m) / 2)
    masses = [each for each in robot.masses if each.mass_kg > 0.0]
    mass_kg = sum(each.mass_kg for each in masses)
    if not mass_kg:
        findings.append("no link has a mass: the draft weighs 5 kg; change mass and diaginertia in robot.xml")
        radius_m = float(np.ptp(touched[:, :2], axis=0).max()) / 2
        center = np.append(touched[:, :2].mean(axis=0), (floor_m + top_m) / 2)
        return _Body(5.0, center, 2.5 * radius_m**2, _discs(touched), low_m, top_m - floor_m, floor_m)
    center = sum((each.mass_kg * each.center_m for each in masses), np.zeros(3)) / mass_kg
    izz = sum(each.izz_kgm2 + each.mass_kg * float(np.sum((each.center_m - center)[:2] ** 2)) for each in masses)
    return _Body(mass_kg, center, max(izz, 1e-5), _discs(touched), low_m, top_m - floor_m, floor_m)


def _points(shape: Shape, request: DraftRequest, findings: list[str]) -> NDArray[np.float64]:
    """Returns points of a shape's surface, whose hull is the shape's, in the robot's frame."""
    if shape.kind == "mesh":
        own = _mesh_points(shape, request, findings)
    elif shape.kind == "box":
        own = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * shape.size
    else:
        radius_m, length_m = shape.size[0], shape.size[1] if len(shape.size) > 1 else 0.0
        turns = np.linspace(0.0, 2 * math.pi, _CORNERS, endpoint=False)
        ring = radius_m * np.stack([np.cos(turns), np.sin(turns), np.zeros(_CORNERS)], axis=1)
        up = np.array([0.0, 0.0, length_m / 2])
        own = np.concatenate([ring + up, ring - up])
        if shape.kind != "cylinder":
            own = np.concatenate(
                [own, ring[:, [0, 2, 1]], [[0, 0, length_m / 2 + radius_m], [0, 0, -length_m / 2 - radius_m]]]
            )
    return own @ shape.pose[:3, :3].T + shape.pose[:3, 3]


def _mesh_points(shape: Shape, request: DraftRequest, findings: list[str]) -> NDArray[np.float64]:
    path = _mesh_file(shape.address, request)
    if path is None or path.stat().st_size > _MOST_MESH_BYTES:
        findings.append(
            f"<mesh {shape.address!r}> of the link {shape.link} is not in the bundle, or too large: the hull lacks it"
        )
        return np.zeros((0, 3))
    try:
        mesh = trimesh.load_mesh(path)
        return np.asarray(mesh.convex_hull.vertices, dtype=float) * shape.size
    except (ValueError, LookupError, AttributeError, TypeError, OSError) as exc:  # of files that are no meshes
        findings.append(
            f"<mesh {shape.address!r}> of the link {shape.link} cannot be read: {str(exc)[:80]}: the hull lacks it"
        )
        return np.zeros((0, 3))


def _mesh_file(address: str, request: DraftRequest) -> Path | None:
    scheme, _, rest = address.rpartition("://")
    first, _, inside = rest.partition("/")
    packages, places = bundle_packages(request.bundle), list[Path]()
    if scheme in ("package", "model") and first in packages:
        places.append(packages[first] / inside)
    if scheme == "model":
        places += [folder / rest for folder in request.model_folders]
    elif scheme in ("file", ""):
        places.append(Path(rest))
    root = request.bundle.resolve()
    return next((each for each in places if each.is_file() and each.resolve().is_relative_to(root)), None)


def _discs(points: NDArray[np.float64]) -> list[tuple[float, float, float]]:
    """Returns discs that cover the outline of some points from above: one if it is round, else some along its rim."""
    outline = shapely.MultiPoint(points[:, :2]).convex_hull.buffer(1e-3)
    circle = _around(outline)
    if outline.area >= _ROUND * math.pi * circle[2] ** 2:
        return [circle]
    x_min, y_min, x_max, y_max = outline.bounds
    side_m = max(x_max - x_min, y_max - y_min) / _CELLS
    inside = outline.buffer(-0.95 * side_m)
    columns = _divided(x_min, x_max, side_m)
    rows = _divided(y_min, y_max, side_m)
    cells = [shapely.box(left, low, right, high) for left, right in columns for low, high in rows]
    parts = (cell.intersection(outline) for cell in cells if not inside.contains(cell))
    return [_around(part) for part in parts if part.area > 1e-6]


def _divided(low_m: float, high_m: float, side_m: float) -> list[tuple[float, float]]:
    """Returns a length divided into equal parts, none longer than about a side."""
    ends = np.linspace(low_m, high_m, 1 + math.ceil((high_m - low_m) / side_m - 0.05)).tolist()
    return list(itertools.pairwise(ends))


def _around(shape: Any) -> tuple[float, float, float]:  # noqa: ANN401 - of shapely
    center = shapely.minimum_bounding_circle(shape).centroid
    return float(center.x), float(center.y), float(shapely.minimum_bounding_radius(shape))


# The files.


def _robot_xml(robot: RobotDescription, drive: _Drive, body: _Body) -> str:
    x, y, z = body.center_m
    name = _plain(robot.name)
    inertia = _n(body.izz_kgm2, body.izz_kgm2, body.izz_kgm2)
    middle_m, half_m = (body.low_m + body.high_m) / 2 + body.floor_m, (body.high_m - body.low_m) / 2
    hull = [
        f'      <geom name="hull_{number}" type="cylinder" pos="{_n(dx, dy, middle_m)}" size="{_n(radius, half_m)}" '
        f'mass="0" condim="1" rgba="0.2 0.3 0.4 1"/>'
        for number, (dx, dy, radius) in enumerate(body.discs)
    ]
    sites, actuators = _motors(drive, body)
    lines = [
        f"<!-- A draft, made of the description of {name}: a planar base. Change what is not so. -->",
        f"<mujoco model={quoteattr(name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="{_STEP_S}" integrator="implicitfast"/>',
        "  <worldbody>",
        f'    <body name="base" pos="0 0 {_n(-body.floor_m)}">',
        '      <joint name="x" type="slide" axis="1 0 0"/>',
        '      <joint name="y" type="slide" axis="0 1 0"/>',
        '      <joint name="yaw" type="hinge" axis="0 0 1"/>',
        "      <!-- All links together, wheels and casters among them. -->",
        f'      <inertial pos="{_n(x, y, z)}" mass="{_n(body.mass_kg)}" diaginertia="{inertia}"/>',
        "      <!-- The hull: what collision shapes cover from above, from the floor to the top. -->",
        *hull,
        *sites,
        "    </body>",
        "  </worldbody>",
        "  <actuator>",
        *actuators,
        "  </actuator>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _motors(drive: _Drive, body: _Body) -> tuple[list[str], list[str]]:
    """Returns the sites and the motors of a base, which come near to what they are told in a control step."""
    mass_kg = body.mass_kg
    grip_n = mass_kg * _GRAVITY
    if drive.kind == "planar":
        kv, turn = mass_kg / _ANSWER_S, body.izz_kgm2 / _ANSWER_S
        limit = f'ctrlrange="{_n(-_FASTEST_M_S, _FASTEST_M_S)}"'
        fastest = _n(-_FASTEST_RAD_S, _FASTEST_RAD_S)
        return ['      <site name="middle" size="0.01"/>'], [
            f'    <velocity name="forward" site="middle" gear="1 0 0 0 0 0" kv="{_n(kv)}" {limit}/>',
            f'    <velocity name="sideways" site="middle" gear="0 1 0 0 0 0" kv="{_n(kv)}" {limit}/>',
            f'    <velocity name="turn" joint="yaw" kv="{_n(turn)}" ctrlrange="{fastest}"/>',
        ]
    half_m = drive.track_m / 2
    away = body.center_m[:2] - [drive.axle_m, 0.0]
    izz = body.izz_kgm2 + mass_kg * float(away @ away)
    kv = max(mass_kg / (2 * _ANSWER_S), izz / (2 * half_m**2 * _ANSWER_S))
    push_n = min(grip_n, drive.push_n) if drive.push_n > 0 else grip_n
    limits = f'ctrlrange="{_n(-drive.speed_m_s, drive.speed_m_s)}" forcerange="{_n(-push_n, push_n)}"'
    sites = [
        f'      <site name="{name}" pos="{_n(drive.axle_m, at_m, 0)}" size="0.01"/>'
        for name, at_m in (("left_wheel", half_m), ("right_wheel", -half_m), ("axle", 0.0))
    ]
    return sites, [
        "    <!-- The speed of each side's wheels over the floor (m/s), with the plugin's torque or their grip. -->",
        f'    <velocity name="left" site="left_wheel" gear="1 0 0 0 0 0" kv="{_n(kv)}" {limits}/>',
        f'    <velocity name="right" site="right_wheel" gear="1 0 0 0 0 0" kv="{_n(kv)}" {limits}/>',
        "    <!-- Wheels do not slide sideways: told 0, it holds. -->",
        f'    <velocity name="hold" site="axle" gear="0 1 0 0 0 0" kv="{_n(2 * mass_kg / _ANSWER_S)}" '
        f'forcerange="{_n(-grip_n, grip_n)}"/>',
    ]


def _n(*values: float) -> str:
    return " ".join(f"{float(value):.6g}" for value in values)


def _plain(name: str) -> str:
    return re.sub(r"[^\w .-]|--+", "_", name)[:80]


def _yaml(declared: dict[str, Any]) -> str:
    return yaml.safe_dump(declared, sort_keys=False, default_flow_style=None, width=120)


def _declaration(robot: RobotDescription, drive: _Drive, body: _Body, findings: list[str]) -> dict[str, Any]:
    """Returns what ``ros.yaml`` says; what it may not say is left at its default, and named."""
    plugin, sensors = drive.plugin, draft_sensors(robot, body.floor_m)
    topics = {
        "command": plugin_topic(plugin, "/cmd_vel", "commandTopic", "command_topic", "topic", remapped="cmd_vel"),
        "odometry": plugin_topic(plugin, "/odom", "odometryTopic", "odometry_topic", "odom_topic", remapped="odom"),
        **sensors.topics,
    }
    frames = {
        "odometry": said(plugin, "odometryFrame", "odometry_frame", "frame_id") or "odom",
        "base": said(plugin, "robotBaseFrame", "robot_base_frame", "child_frame_id") or robot.base,
        **sensors.frames,
    }
    findings += sensors.findings
    findings += _sensors_not_taken(robot, sensors)
    drives: dict[str, Any] = {"kind": "velocity", "sideways": "sideways"}
    if drive.kind == "differential":
        drives = {"kind": "differential", "left": "left", "right": "right", "track_m": round(drive.track_m, 6)}
    declared = {"topics": topics, "frames": frames, **sensors.sensors, "drive": drives}
    return _allowed(declared, findings)


def _allowed(declared: dict[str, Any], findings: list[str]) -> dict[str, Any]:
    """Returns a declaration without what ``ros.yaml`` may not say, which is named."""
    try:
        RosRobot.model_validate(declared)
    except ValidationError as exc:
        for each in exc.errors():
            part, *rest = each["loc"] or ("topics",)
            inner = declared[str(part)]
            key = str(rest[0]) if rest else ""
            where = f"{part}.{key}" if key else str(part)
            findings.append(f"{where} {str(each['input'])[:80]!r} is not taken: {each['msg']}")
            if isinstance(inner, dict) and key in inner:
                inner.pop(key)  # type: ignore[reportUnknownMemberType]
            else:
                declared.pop(str(part))
    return declared


def _not_taken(robot: RobotDescription, drive: _Drive) -> Iterator[str]:
    """Yields what of a description is in neither file."""
    plugin = drive.plugin
    for tag in ("wheelAcceleration", "max_wheel_acceleration", "max_linear_acceleration"):
        if number(plugin, tag):
            yield f"{shown(plugin)}: <{tag}> is not taken: the base is as quick as its torque and its grip"
    if drive.kind == "differential" and robot.joints:
        yield f"joints do not move, and /joint_states lacks them: {', '.join(robot.joints)}"[:300]
    for each in robot.plugins:
        if each is not plugin and "imu" not in library(each):
            yield f"{shown(each)} is not taken: {_why(each)}"


def _sensors_not_taken(robot: RobotDescription, draft: SensorDraft) -> Iterator[str]:
    """Yields what sensors of a description are in no file."""
    for sensor in robot.sensors:
        if sensor.element not in draft.taken:
            kind = _RANGES if "ros_range" in library(sensor.element.find("plugin")) else sensor.element.get("type", "")
            why = f"ros.yaml declares {_DECLARED[kind]}" if kind in _DECLARED else "Simyard has no such sensor"
            yield f"{shown(sensor.element)} of {sensor.link} is not taken: {why}"


_RANGES = "sonar"
_DECLARED = {_RANGES: "range_finders", "magnetometer": "compass", "gps": "gps", "navsat": "gps"}


def _why(plugin: Element) -> str:
    name = library(plugin)
    if "joint_state" in name:
        return "its joints do not move"
    if "p3d" in name or "odometry-publisher" in name:
        return f"the true pose is on no topic of its own ({said(plugin, 'topicName', 'odom_topic') or 'odom'})"
    if "bumper" in name or "contact" in name:
        return "a bumper is declared in ros.yaml, with messages of its own"
    return "code of a simulator, which is not run here"


def main() -> None:
    """Answers the request that it reads."""
    request = DraftRequest.model_validate_json(sys.stdin.read())
    try:
        draft = draft_robot(request)
    except LaunchRefused as refused:
        draft = RobotDraft(refused=str(refused))
    sys.stdout.write("\n" + draft.model_dump_json() + "\n")


if __name__ == "__main__":
    main()
