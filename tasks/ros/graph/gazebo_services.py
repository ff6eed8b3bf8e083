"""What Gazebo's services answer of an episode (ROS 1): where the robot is, and what the world is.

Names and types are those of gazebo_ros (wiki.ros.org/gazebo_ros, package gazebo_msgs of its branch noetic-devel).
Nobody but the robot moves in a world. It moves by its commands, and where it is set: who asks for more is told so.
"""

import math
import struct
from collections.abc import Callable, Mapping
from typing import NamedTuple

from tasks.ros.message.ros_messages import (
    TWIST_BYTES,
    PlanarTwist,
    header,
    read_text,
    stamp,
    text_bytes,
    twist,
    write_outcome,
    yaw_quaternion,
)

MODEL_STATES, MODEL_STATES_KIND = "/gazebo/model_states", "gazebo_msgs/ModelStates"
SET_MODEL_STATE = "/gazebo/set_model_state"
SET_MODEL_STATE_KIND = "gazebo_msgs/ModelState"
"""Of the topic; the service of that name has another type."""
GAZEBO_SERVICES: Mapping[str, str] = {
    "/gazebo/get_model_state": "gazebo_msgs/GetModelState",
    "/gazebo/get_physics_properties": "gazebo_msgs/GetPhysicsProperties",
    "/gazebo/get_world_properties": "gazebo_msgs/GetWorldProperties",
    "/gazebo/pause_physics": "std_srvs/Empty",
    "/gazebo/reset_simulation": "std_srvs/Empty",
    "/gazebo/reset_world": "std_srvs/Empty",
    SET_MODEL_STATE: "gazebo_msgs/SetModelState",
    "/gazebo/set_physics_properties": "gazebo_msgs/SetPhysicsProperties",
    "/gazebo/unpause_physics": "std_srvs/Empty",
}
"""Types by name."""
_GROUND, _NO = "ground_plane", b"\0"
_POSE = struct.Struct("<7d")
_PHYSICS = struct.Struct("<dBd3d")
# Of ODE, which does not step here: its own defaults, as far as anybody reads them.
_ODE = struct.Struct("<BII6dI")
_GRAVITY_M_S2 = (0.0, 0.0, -9.81)
_ASKED = struct.Struct("<d8x3d")
# Farther than any world reaches.
_FARTHEST_M = 1e4


class RobotState(NamedTuple):
    """Where a robot is.

    Attributes:
        time_ns: Simulated time.
        pose: (x m, y m, yaw rad).
        velocity: In its own frame: (m/s ahead, m/s to the left, rad/s).
    """

    time_ns: int = 0
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)


class GazeboServices:
    """Answers for Gazebo in one episode.

    Args:
        model: What the robot is called.
        step_s: Of the physics.

    Attributes:
        state: The robot's, as its odometry has it, or where it was set in this control step.
        functions: What answers requests, by the services' names.
    """

    def __init__(self, model: str, step_s: float) -> None:
        self.state = RobotState()
        self._model, self._step_s = model, step_s
        self._asked = self._placements = 0
        self._start: tuple[float, float, float] | None = None
        self._set: tuple[float, float, float] | None = None
        self.functions: Mapping[str, Callable[[bytes], bytes]] = {
            "/gazebo/get_model_state": self._model_state,
            "/gazebo/get_physics_properties": self._physics,
            "/gazebo/get_world_properties": self._world,
            "/gazebo/pause_physics": lambda _: b"",
            "/gazebo/reset_simulation": self._reset,
            "/gazebo/reset_world": self._reset,
            SET_MODEL_STATE: lambda request: _answer("SetModelState", self.set_state(request), "set model state done"),
            "/gazebo/set_physics_properties": self._set_physics,
            "/gazebo/unpause_physics": lambda _: b"",
        }

    def model_states(self) -> bytes:
        """Returns a ``gazebo_msgs/ModelStates``: of the ground and the robot."""
        still = _pose((0.0, 0.0, 0.0)) + _POSE.pack(*[0.0] * 7)[:48]
        ground, robot = still, self._placed()
        names = struct.pack("<I", 2) + text_bytes(_GROUND) + text_bytes(self._model)
        poses = struct.pack("<I", 2) + ground[: _POSE.size] + robot[: _POSE.size]
        return names + poses + struct.pack("<I", 2) + ground[_POSE.size :] + robot[_POSE.size :]

    def _placed(self) -> bytes:
        """Returns the robot's pose, and its twist along the world's axes."""
        return _pose(self.state.pose) + twist(PlanarTwist(*_turned(self.state)))

    def _model_state(self, request: bytes) -> bytes:
        name, rest = read_text(request)
        relative, _ = read_text(rest)
        self._asked += 1
        head = header(self._asked, stamp(self.state.time_ns), relative)
        if name != self._model or relative not in ("", "world"):
            known = f"{name!r} relative to {relative!r}: only {self._model}, the robot, relative to the world, is known"
            return head + _pose((0.0, 0.0, 0.0)) + bytes(48) + write_outcome(success=False, message=known)
        told = "GetModelState: got properties"
        return head + self._placed() + write_outcome(success=True, message=told)

    def _world(self, _: bytes) -> bytes:
        names = struct.pack("<I", 2) + text_bytes(_GROUND) + text_bytes(self._model)
        told = write_outcome(success=True, message="GetWorldProperties: got properties")
        return struct.pack("<d", self.state.time_ns / 1e9) + names + _NO + told

    def _physics(self, _: bytes) -> bytes:
        numbers = _PHYSICS.pack(self._step_s, 0, 0.0, *_GRAVITY_M_S2)
        ode = _ODE.pack(0, 0, 50, 1.3, 0.0, 0.001, 100.0, 0.0, 0.2, 20)
        return numbers + ode + write_outcome(success=True, message="GetPhysicsProperties: got properties")

    def tell(self, state: RobotState) -> None:
        """Tells where the robot is now; the first time, where it starts."""
        self.state = state
        self._start = self._start or state.pose

    def take_pose(self) -> tuple[float, float, float] | None:
        """Returns where the robot was set since the last call, the last time; None if it was not."""
        pose, self._set = self._set, None
        return pose

    def placements(self) -> int:
        """Returns how often the robot was set somewhere since the last call."""
        count, self._placements = self._placements, 0
        return count

    def set_state(self, request: bytes) -> str:
        """Sets the robot somewhere, at rest, as a ``gazebo_msgs/ModelState`` says; returns why it does not, or nothing.

        Raises:
            ValueError: If the bytes are no such message.
        """
        name, rest = read_text(request)
        if len(rest) < _POSE.size + TWIST_BYTES:
            raise ValueError(f"a pose and a twist within {len(rest)} bytes")
        relative, _ = read_text(rest[_POSE.size + TWIST_BYTES :])
        x, y, _, qx, qy, qz, qw = numbers = _POSE.unpack_from(rest)
        if name != self._model:
            return f"{name!r} stands still here, as all but {self._model}: import another world, or a variant of it"
        if relative not in ("", "world"):
            return f"relative to {relative!r}: a pose relative to the world is known alone"
        if not all(map(math.isfinite, numbers)) or max(abs(x), abs(y)) > _FARTHEST_M:
            return f"the pose {numbers} is none: finite numbers, at most {_FARTHEST_M:g} m away"
        self._place((x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))))
        return ""

    def _place(self, pose: tuple[float, float, float]) -> None:
        self._set, self.state = pose, RobotState(self.state.time_ns, pose)
        self._placements += 1

    def _reset(self, _: bytes) -> bytes:
        if self._start is not None:
            self._place(self._start)
        return b""

    def _set_physics(self, request: bytes) -> bytes:
        if len(request) != _ASKED.size + _ODE.size:
            raise ValueError(f"{len(request)} bytes, {_ASKED.size + _ODE.size} are taken")
        step_s, *gravity = _ASKED.unpack_from(request)
        same = math.isclose(step_s, self._step_s) and tuple(gravity) == _GRAVITY_M_S2
        why = "" if same else f"steps have {self._step_s:g} s here, and gravity is {_GRAVITY_M_S2}: nothing is set"
        return _answer("SetPhysicsProperties", why, "physics is as asked for")


def _answer(service: str, why: str, done: str) -> bytes:
    return write_outcome(success=not why, message=f"{service}: {why or done}")


def _pose(pose: tuple[float, float, float]) -> bytes:
    x, y, yaw = pose
    return _POSE.pack(x, y, 0.0, *yaw_quaternion(yaw))


def _turned(state: RobotState) -> tuple[float, float, float]:
    """Returns a robot's velocity along the world's axes."""
    (_, _, z, w), (ahead, left, turn) = yaw_quaternion(state.pose[2]), state.velocity
    cos, sin = w * w - z * z, 2.0 * w * z
    return cos * ahead - sin * left, sin * ahead + cos * left, turn
