"""Names, hashes and what endpoints say of their types, held against what ROS 2 publishes."""

from typing import Any

import numpy as np
import pytest

from tasks.ros.message.camera_messages import Pinhole, camera_info, compressed_image, image, point_cloud
from tasks.ros.message.ros_messages import EarthPlace, magnetic_field, range_reading, satellite_fix, stamp
from tasks.ros.ros2.interface_types import (
    ADD_TAGS,
    CANCEL,
    NAVIGATE,
    beyond_ros1,
    dds_type_name,
    reply_name,
    request_name,
    topic_name,
    type_hash,
    type_store,
    user_data,
)
from tasks.ros.ros2.ros2_installation import DISTRIBUTIONS

# As ROS 2 Jazzy and Iron show them: rmw_zenoh's design document (String), `ros2 topic info --verbose` in tutorials
# (Twist, JointState, OccupancyGrid), rosidl's generated sources (Gid, ParticipantEntitiesInfo), and type_hashes of
# share/*/msg/*.json (the rest); of nav2_msgs, what rosidl_generator_type_description 4.6.6 makes of Nav2's jazzy.
PUBLISHED = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "std_msgs/msg/Header": "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "rosgraph_msgs/msg/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "geometry_msgs/msg/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "nav_msgs/msg/OccupancyGrid": "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "sensor_msgs/msg/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "sensor_msgs/msg/LaserScan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "sensor_msgs/msg/MagneticField": "e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
    "sensor_msgs/msg/NavSatFix": "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "sensor_msgs/msg/Range": "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    "std_msgs/msg/UInt8MultiArray": "5687e861b8d307a5e48b7515467ae7a5fc2daf805bd0ce6d8e9e604bade9f385",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    f"{NAVIGATE}_Goal": "22a9dffbd6733011220460bd52edbc7843c8fc86282d40bc7ad3ca176a9dec10",
    f"{NAVIGATE}_Result": "ddbff7fc6d1e51d774d5defdb8398a57cb23fa8709355002d676408bb4860b85",
    f"{NAVIGATE}_SendGoal_Request": "e9381f2acfe9fa8c4838a277d0cde28a93c483564827b9f13496b9c2092e4f09",
    f"{NAVIGATE}_SendGoal_Response": "99f97fcbb07daf024df4b8c3f02f19ce7fa3183fcedfb76b8772a61a371a55fa",
    f"{NAVIGATE}_GetResult_Request": "106d3457cf0db4c4a8d3373bab3ff6aa8ba8ad99ae6392ce9784830a7d04ac93",
    f"{NAVIGATE}_GetResult_Response": "c59f178c377de5318919c00bdbf7884cb3b185acfdffceba6c9f161e0aa3cc81",
    "rmw_dds_common/msg/Gid": "ab6f21cfbb0a6dbb837161e1110c2051a2850ed9f9c53944d7115d9bcebedf71",
    "rmw_dds_common/msg/ParticipantEntitiesInfo": "91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e",
}


@pytest.mark.parametrize("kind", PUBLISHED)
def test_a_type_has_the_hash_that_ros_2_publishes(kind: str) -> None:
    assert type_hash(kind) == f"RIHS01_{PUBLISHED[kind]}"


# Humble has no variance of a range.
_NOT_EVERYWHERE = ("rmw", "nav2", "sensor_msgs/msg/Range")


@pytest.mark.parametrize("kind", [kind for kind in PUBLISHED if not kind.startswith(_NOT_EVERYWHERE)])
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_the_robots_types_are_the_same_in_all_distributions(kind: str, distribution: str) -> None:
    assert type_hash(kind, distribution) == f"RIHS01_{PUBLISHED[kind]}"


def test_names_on_dds_are_those_of_ros_2() -> None:
    assert topic_name("/scan") == "rt/scan"
    assert request_name("/robomaker/job/cancel") == "rq/robomaker/job/cancelRequest"
    assert reply_name("/robomaker/job/cancel") == "rr/robomaker/job/cancelReply"
    assert dds_type_name("sensor_msgs/msg/LaserScan") == "sensor_msgs::msg::dds_::LaserScan_"
    assert dds_type_name(f"{ADD_TAGS}_Request") == "robomaker_simulation_msgs::srv::dds_::AddTags_Request_"


def test_user_data_holds_the_hash_since_iron() -> None:
    said = f"typehash=RIHS01_{PUBLISHED['geometry_msgs/msg/Twist']};".encode()
    assert user_data("geometry_msgs/msg/Twist", "jazzy") == said
    assert user_data("geometry_msgs/msg/Twist", "jazzy", "serviceid=1.2;") == b"serviceid=1.2;" + said
    assert user_data("geometry_msgs/msg/Twist", "humble") == b""


def test_a_gid_has_24_bytes_in_humble_and_16_since_iron() -> None:
    sizes = {each: type_store(each).fielddefs["rmw_dds_common/msg/Gid"][1][0][1][1][1] for each in DISTRIBUTIONS}
    assert sizes == {"humble": 24, "iron": 16, "jazzy": 16, "kilted": 16}


def test_a_request_without_fields_is_a_byte_on_the_wire() -> None:
    store = type_store()
    kind = f"{CANCEL}_Request"
    assert bytes(store.serialize_cdr(store.types[kind](), kind)) == b"\x00\x01\x00\x00\x00"


def _sent() -> dict[str, bytes]:
    """Returns a message of each type that cameras and range finders send, in ROS 1's form."""
    camera, now = Pinhole(4, 3, 1.0), stamp(1_500_000_000)
    depth_m = np.full((3, 4), 2.0, np.float32)
    return {
        "Image": image(1, now, "eye", depth_m),
        "CompressedImage": compressed_image(1, now, "eye", np.zeros((3, 4, 3), np.uint8)),
        "CameraInfo": camera_info(1, now, "eye", camera),
        "MagneticField": magnetic_field(1, now, "eye", (20.0, 0.0, -45.0), 0.0),
        "NavSatFix": satellite_fix(1, now, "eye", EarthPlace(48.1, 11.6, 520.0), 2.0),
        "PointCloud2": point_cloud(1, now, "eye", camera, depth_m),
        "Range": range_reading(1, now, "eye", 0.5, radiation=0, cone_rad=0.3, range_max=4.0),
    }


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_what_cameras_send_is_the_same_in_ros_2(distribution: str) -> None:
    store, found = type_store(distribution), dict[str, Any]()
    for name, ros1 in _sent().items():
        kind = f"sensor_msgs/msg/{name}"
        cdr = bytes(store.ros1_to_cdr(ros1 + beyond_ros1(kind, distribution), kind))
        found[name] = store.deserialize_cdr(cdr, kind)
        assert (found[name].header.frame_id, found[name].header.stamp.nanosec) == ("eye", 500_000_000)
    assert (found["Image"].encoding, found["Image"].step, len(found["Image"].data)) == ("32FC1", 16, 48)
    assert (found["MagneticField"].magnetic_field.z, found["NavSatFix"].status.service) == (-45e-6, 1)
    assert found["CompressedImage"].format == "rgb8; jpeg compressed bgr8"
    assert (found["CameraInfo"].k[2], found["CameraInfo"].roi.do_rectify) == (1.5, False)
    assert (found["PointCloud2"].fields[2].name, len(found["PointCloud2"].data)) == ("z", 144)
    assert (found["Range"].range, getattr(found["Range"], "variance", 0.0)) == (0.5, 0.0)
