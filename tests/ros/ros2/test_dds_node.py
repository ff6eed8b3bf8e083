"""CDR of every message that the robot sends: rosbags' bytes, cyclonedds' bytes, and those of ROS 1 made into CDR."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tasks.ros.message import ros_messages as motion
from tasks.ros.message import ros_messages as sensor
from tasks.ros.message.ros_messages import stamp
from tasks.ros.ros2.dds_node import structure, wire_type
from tasks.ros.ros2.interface_types import ADD_TAGS, CANCEL, type_store

NOW = stamp(12_345_678_901)
_SOUTH = motion.FrameTransform("odom", "base_link", (1.5, -2.5, 0.7))
_CELLS = np.array([[0, 100, -1], [100, 0, 0]], np.int8)
ROBOT = {
    "rosgraph_msgs/msg/Clock": motion.clock(NOW),
    "tf2_msgs/msg/TFMessage": motion.transforms(7, NOW, [_SOUTH, _SOUTH._replace(parent="a", child="bc")]),
    "nav_msgs/msg/Odometry": motion.odometry(7, NOW, np.array([1.5, -2.5, 0.7]), np.array([0.4, 0.0, 0.1])),
    "geometry_msgs/msg/PoseStamped": motion.pose_stamped(7, NOW, "odom", (2.0, 3.0, 0.0)),
    "nav_msgs/msg/OccupancyGrid": motion.occupancy_grid(0, NOW, "map", _CELLS, origin_m=(-1.0, 2.0), cell_m=0.05),
    "sensor_msgs/msg/LaserScan": sensor.laser_scan(
        7, NOW, "laser", np.linspace(0.1, 9.0, 31), angle_min=-1.5, angle_increment=0.1, range_max=8.0, scan_s=0.05
    ),
    "sensor_msgs/msg/Imu": sensor.imu(
        7, NOW, "imu_link", sensor.Inertia((0.0, 0.0, 0.1), (0.2, -0.3, 9.81), yaw_rad=0.5)
    ),
    "sensor_msgs/msg/JointState": sensor.joint_state(
        7, NOW, ["left", "the right one"], np.array([0.5, 1.0]), np.array([2.0, 3.0])
    ),
    "std_msgs/msg/UInt8MultiArray": sensor.bumper(np.array([True, False, True])),
    "geometry_msgs/msg/Twist": motion.twist(motion.PlanarTwist(0.3, -0.1, 1.5)),
}


def _cyclone(kind: str, cdr: bytes) -> bytes:
    """Returns a message as cyclonedds writes it in XCDR1, having read it."""
    whole = structure(kind)
    padded = cdr.ljust(-(-len(cdr) // 4) * 4, b"\0")
    return bytes(whole.deserialize(padded).serialize(use_version_2=False))


@pytest.mark.parametrize("kind", ROBOT)
def test_a_message_is_the_same_bytes_by_rosbags_and_by_cyclonedds(kind: str) -> None:
    store = type_store()
    cdr = bytes(store.ros1_to_cdr(ROBOT[kind], kind))
    assert cdr[:4] == b"\x00\x01\x00\x00", "XCDR1, little endian"
    assert cdr == bytes(store.serialize_cdr(store.deserialize_cdr(cdr, kind), kind))
    assert cdr == _cyclone(kind, cdr)


@given(
    arrays(np.float32, st.integers(0, 64), elements=st.floats(0.0, 10.0, width=32)),
    st.text(st.characters(codec="ascii", min_codepoint=33), min_size=0, max_size=9),
)
def test_a_scan_of_any_length_in_any_frame_is_the_same_bytes(ranges: np.ndarray, frame: str) -> None:
    kind = "sensor_msgs/msg/LaserScan"
    ros1 = sensor.laser_scan(1, NOW, frame, ranges, angle_min=0.0, angle_increment=0.1, range_max=8.0, scan_s=0.1)
    cdr = bytes(type_store().ros1_to_cdr(ros1, kind))
    assert cdr == _cyclone(kind, cdr)


@pytest.mark.parametrize("kind", [f"{ADD_TAGS}_Response", f"{CANCEL}_Request", "rmw_dds_common/msg/Gid"])
def test_types_of_services_and_of_discovery_are_the_same_bytes(kind: str) -> None:
    store = type_store()
    values = {
        f"{ADD_TAGS}_Response": {"success": True, "message": "so"},
        f"{CANCEL}_Request": {},
        "rmw_dds_common/msg/Gid": {"data": np.arange(16, dtype=np.uint8)},
    }
    cdr = bytes(store.serialize_cdr(store.types[kind](**values[kind]), kind))
    assert cdr == _cyclone(kind, cdr)


def test_a_request_begins_with_whose_it_is() -> None:
    tags = structure("robomaker_simulation_msgs/msg/Tag")(key="a", value="bcd")  # type: ignore[call-arg]
    request = structure(f"{ADD_TAGS}_Request", service=True)(guid=5, sequence=7, tags=[tags])  # type: ignore[call-arg]
    cdr = bytes(request.serialize(use_version_2=False))
    assert cdr[4:20] == (5).to_bytes(8, "little") + (7).to_bytes(8, "little")
    message = type_store().deserialize_cdr(cdr[:4] + cdr[20:], f"{ADD_TAGS}_Request")
    assert [(each.key, each.value) for each in message.tags] == [("a", "bcd")]  # type: ignore[attr-defined]


def test_bytes_go_through_a_wire_type_as_they_are() -> None:
    kind = wire_type("geometry_msgs/msg/Twist")
    assert kind(b"any bytes").serialize() == b"any bytes"
    assert kind.deserialize(b"others").cdr == b"others"
