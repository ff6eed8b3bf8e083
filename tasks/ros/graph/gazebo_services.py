"""What Gazebo's services answer of an episode (ROS 1): where the robot is, and what the world is.

Names and types are those of gazebo_ros (wiki.ros.org/gazebo_ros, package gazebo_msgs of its branch noetic-devel).
Nobody but the robot moves in a world, and the robot moves by its commands alone: who asks for more is told so.
"""

import struct
from collections.abc import Callable, Mapping
from typing import NamedTuple

from tasks.ros.message.ros_messages import (
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
GAZEBO_SERVICES: Mapping[str, str] = {
    "/gazebo/get_model_state": "gazebo_msgs/GetModelState",
    "/gazebo/get_physics_properties": "gazebo_msgs/GetPhysicsProperties",
    "/gazebo/get_world_properties": "gazebo_msgs/GetWorldProperties",
    "/gazebo/pause_physics": "std_srvs/Empty",
    "/gazebo/set_model_state": "gazebo_msgs/SetModelState",
    "/gazebo/unpause_physics": "std_srvs/Empty",
}
"""Types by name."""
_GROUND, _NO = "ground_plane", b"\0"
_POSE = struct.Struct("<7d")
_PHYSICS = struct.Struct("<dBd3d")
# Of ODE, which does not step here: its own defaults, as far as anybody reads them.
_ODE = struct.Struct("<BII6dI")
_GRAVITY_M_S2 = (0.0, 0.0, -9.81)


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
        state: The robot's, as its odometry has it.
        functions: What answers requests, by the services' names.
    """

    def __init__(self, model: str, step_s: float) -> None:
        self.state = RobotState()
        self._model, self._step_s = model, step_s
        self._asked = 0
        self.functions: Mapping[str, Callable[[bytes], bytes]] = {
            "/gazebo/get_model_state": self._model_state,
            "/gazebo/get_physics_properties": self._physics,
            "/gazebo/get_world_properties": self._world,
            "/gazebo/pause_physics": lambda _: b"",
            "/gazebo/set_model_state": self._set_model_state,
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

    def _set_model_state(self, request: bytes) -> bytes:
        name, _ = read_text(request)
        why = f"{name!r} stands still here, as all but {self._model}: import another world, or a variant of it"
        if name == self._model:
            why = f"{name} moves by its commands alone here: let the world's start say where an episode begins"
        return write_outcome(success=False, message=f"SetModelState: {why}")


def _pose(pose: tuple[float, float, float]) -> bytes:
    x, y, yaw = pose
    return _POSE.pack(x, y, 0.0, *yaw_quaternion(yaw))


def _turned(state: RobotState) -> tuple[float, float, float]:
    """Returns a robot's velocity along the world's axes."""
    (_, _, z, w), (ahead, left, turn) = yaw_quaternion(state.pose[2]), state.velocity
    cos, sin = w * w - z * z, 2.0 * w * z
    return cos * ahead - sin * left, sin * ahead + cos * left, turn
