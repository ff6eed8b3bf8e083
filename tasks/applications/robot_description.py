"""A robot's description as Gazebo has it: links, shapes, joints, sensors and plugins of a URDF or an SDF model.

All poses are in the frame of the robot's first link, with all joints at 0. Whoever wrote it may have meant harm: what
is read is bounded, and a number that is none is a refusal.

Sources: ROS's specification of URDF (links, joints, ``<gazebo>``); SDFormat's specification of models.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from specs.errors import LaunchRefused
from tasks.ros.launch.packages import plain_xml

Pose = NDArray[np.float64]
_MOST_LINKS = 2_000
_LARGEST = 1e6
_SIZES: Mapping[str, tuple[str, ...]] = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
}


class Shape(NamedTuple):
    """What of a link something can touch.

    Attributes:
        link: The link's name.
        kind: ``box``, ``cylinder``, ``sphere``, ``capsule`` or ``mesh``.
        size: Its measures in metres, in the order of the description; of a mesh, its scale.
        pose: Where it is.
        address: Of a mesh's file.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    pose: Pose
    address: str = ""


class Mass(NamedTuple):
    """A link's mass.

    Attributes:
        mass_kg: How much.
        center_m: Where, in the frame of the robot.
        izz_kgm2: Its inertia about an upright axis through its centre.
    """

    mass_kg: float
    center_m: NDArray[np.float64]
    izz_kgm2: float


class Joint(NamedTuple):
    """A joint that moves.

    Attributes:
        child: The link that it moves.
        pose: Where it is.
        limit_rad_s: How fast it may turn; 0 if that is not said.
    """

    child: str
    pose: Pose
    limit_rad_s: float


class Sensor(NamedTuple):
    """A sensor.

    Attributes:
        link: That carries it.
        pose: Where it is.
        element: As it is written.
    """

    link: str
    pose: Pose
    element: Element


class RobotDescription(NamedTuple):
    """A robot as it is described.

    Attributes:
        name: What it is called.
        base: Its first link.
        links: Poses of all links.
        joints: Those that move.
        shapes: What can be touched.
        masses: Of the links that have one.
        sensors: In their order.
        plugins: Those of the whole robot, in their order.
    """

    name: str
    base: str
    links: Mapping[str, Pose]
    joints: Mapping[str, Joint]
    shapes: tuple[Shape, ...]
    masses: tuple[Mass, ...]
    sensors: tuple[Sensor, ...]
    plugins: tuple[Element, ...]


def read_description(text: str) -> RobotDescription:
    """Returns a robot of its URDF or SDF.

    Raises:
        LaunchRefused: It is neither, or says what no robot can be.
    """
    root = plain_xml(text.encode(), "the robot's description", "URDF or SDF")
    if root.tag == "robot":
        return _of_urdf(root)
    model = root.find("model") if root.tag == "sdf" else None
    if model is None:
        raise LaunchRefused(f"the robot's description begins with <{root.tag[:40]}>, not with <robot> or <sdf><model>")
    return _of_sdf(model)


def said(element: Element | None, *names: str) -> str:
    """Returns the text of the first of some elements that is there, or of an attribute of that name."""
    if element is None:
        return ""
    for name in names:
        found = element.find(name)
        text = (found.text or "").strip() if found is not None else element.get(name, "").strip()
        if text:
            return text
    return ""


def number(element: Element | None, *names: str, default: float = 0.0) -> float:
    """Returns the number of the first of some elements that is there.

    Raises:
        LaunchRefused: It is none.
    """
    text = said(element, *names)
    return _numbers(text, 1, names[0])[0] if text else default


def _numbers(text: str, count: int, what: str) -> list[float]:
    try:
        found = [float(each) for each in text.split()]
    except ValueError:
        found = []
    if len(found) != count or not all(math.isfinite(each) and abs(each) <= _LARGEST for each in found):
        raise LaunchRefused(f"the robot's description: {what} is {text[:80]!r}, not {count} numbers of at most 10^6")
    return found


def _pose(position: Sequence[float], turn: Sequence[float]) -> Pose:
    """Returns a pose: turns about the fixed axes x, y and z, in this order, then the position."""
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, turn), map(math.sin, turn)
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = position
    return pose


def _mass(pose: Pose, mass_kg: float, inertia: Element | None) -> Mass:
    """Returns a link's mass; its inertia about an upright axis follows from the pose of its frame."""
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    xx, yy, zz, xy, xz, yz = (number(inertia, name) for name in names)
    tensor = pose[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ pose[:3, :3].T
    return Mass(max(0.0, mass_kg), pose[:3, 3], max(0.0, float(tensor[2, 2])))


# URDF: a tree of links, each placed by the joint above it.


def _of_urdf(root: Element) -> RobotDescription:
    joints = list(root.findall("joint"))
    above = {_end(joint, "child"): joint for joint in joints}
    names = [link.get("name", "") for link in root.findall("link")]
    if not names or len(names) > _MOST_LINKS:
        raise LaunchRefused(f"the robot's description has {len(names)} links; a robot has 1 to {_MOST_LINKS}")
    links = {name: _place(name, above) for name in names}
    base = next((name for name in names if name not in above), names[0])
    moving = {
        joint.get("name", ""): Joint(
            _end(joint, "child"), links[_end(joint, "child")], number(joint.find("limit"), "velocity")
        )
        for joint in joints
        if joint.get("type") != "fixed" and _end(joint, "child") in links
    }
    shapes = [each for link in root.findall("link") for each in _shapes(link, links[link.get("name", "")], _origin)]
    masses = [each for link in root.findall("link") for each in _urdf_masses(link, links[link.get("name", "")])]
    extensions = list(root.findall("gazebo"))
    sensors = [
        Sensor(link, links[link] @ _sdf_pose(sensor), sensor)
        for extension in extensions
        if (link := extension.get("reference", "")) in links
        for sensor in extension.findall("sensor")
    ]
    plugins = [plugin for extension in extensions for plugin in extension.findall("plugin")]
    name = root.get("name", "") or "robot"
    return RobotDescription(name, base, links, moving, (*shapes,), (*masses,), (*sensors,), (*plugins,))


def _end(joint: Element, name: str) -> str:
    end = joint.find(name)
    return "" if end is None else end.get("link", "")


def _origin(element: Element | None) -> Pose:
    origin = None if element is None else element.find("origin")
    if origin is None:
        return np.eye(4)
    return _pose(_numbers(origin.get("xyz", "0 0 0"), 3, "xyz"), _numbers(origin.get("rpy", "0 0 0"), 3, "rpy"))


def _place(link: str, above: Mapping[str, Element]) -> Pose:
    """Returns a link's pose in the frame of the first one."""
    pose, seen = np.eye(4), set[str]()
    while link in above:
        if link in seen:
            raise LaunchRefused(f"the robot's description: the link {link[:80]} is below itself")
        seen.add(link)
        pose = _origin(above[link]) @ pose
        link = _end(above[link], "parent")
    return pose


def _shapes(link: Element, pose: Pose, place: Callable[[Element], Pose]) -> Iterator[Shape]:
    """Yields what of a link can be touched; ``place`` tells where a description says that a part of it is."""
    name = link.get("name", "")
    for collision in link.findall("collision"):
        geometry, at = collision.find("geometry"), pose @ place(collision)
        for element in geometry if geometry is not None else ():
            if element.tag == "mesh":
                scale = _numbers(said(element, "scale") or "1 1 1", 3, "scale")
                yield Shape(name, "mesh", (*scale,), at, said(element, "uri", "filename"))
            elif element.tag in _SIZES:
                yield Shape(name, element.tag, _size(element), at)


def _size(element: Element) -> tuple[float, ...]:
    counts = {"size": 3}
    found = [_numbers(said(element, name), counts.get(name, 1), name) for name in _SIZES[element.tag]]
    return tuple(abs(each) for part in found for each in part)


def _urdf_masses(link: Element, pose: Pose) -> Iterator[Mass]:
    inertial = link.find("inertial")
    if inertial is not None and inertial.find("mass") is not None:
        mass_kg = _numbers(inertial.find("mass").get("value", ""), 1, "mass")[0]  # type: ignore[reportOptionalMemberAccess]
        yield _mass(pose @ _origin(inertial), mass_kg, inertial.find("inertia"))


# SDF: links side by side in the model.


def _of_sdf(model: Element) -> RobotDescription:
    elements = {link.get("name", ""): link for link in model.findall("link")}
    if not elements or len(elements) > _MOST_LINKS:
        raise LaunchRefused(f"the robot's description has {len(elements)} links; a robot has 1 to {_MOST_LINKS}")
    links = {name: _sdf_pose(link) for name, link in elements.items()}
    joints = {
        joint.get("name", ""): Joint(child, links[child], number(joint.find("axis/limit"), "velocity"))
        for joint in model.findall("joint")
        if joint.get("type") != "fixed" and (child := said(joint, "child")) in links
    }
    shapes = [each for name, link in elements.items() for each in _shapes(link, links[name], _sdf_pose)]
    masses = [each for name, link in elements.items() for each in _sdf_masses(link, links[name])]
    sensors = [
        Sensor(name, links[name] @ _sdf_pose(sensor), sensor)
        for name, link in elements.items()
        for sensor in link.findall("sensor")
    ]
    name, base = model.get("name", "") or "robot", next(iter(elements))
    plugins = model.findall("plugin")
    return RobotDescription(name, base, links, joints, (*shapes,), (*masses,), (*sensors,), (*plugins,))


def _sdf_pose(element: Element) -> Pose:
    text = said(element, "pose")
    found = _numbers(text, 6, "pose") if text else [0.0] * 6
    return _pose(found[:3], found[3:])


def _sdf_masses(link: Element, pose: Pose) -> Iterator[Mass]:
    inertial = link.find("inertial")
    if inertial is not None:
        mass_kg = number(inertial, "mass", default=1.0)
        yield _mass(pose @ _sdf_pose(inertial), mass_kg, inertial.find("inertia"))
