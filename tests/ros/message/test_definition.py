"""Digests of the robot's types are those that ROS publishes; definitions hold all types within a type."""

import pytest

from tasks.ros.message.definition import MESSAGES, SERVICES, definition, type_digest

# As ROS's own packages have them (docs.ros.org/en/noetic/api); of RoboMaker's, as its generated code has them.
PUBLISHED = {
    # gazebo_msgs as of github.com/ros-simulation/gazebo_ros_pkgs, branch noetic-devel, by ROS's genmsg.
    "gazebo_msgs/GetModelState": "4c515e936d3319c9610c559c60bfc3d4",
    "gazebo_msgs/GetPhysicsProperties": "575a5e74786981b7df2e3afc567693a6",
    "gazebo_msgs/GetWorldProperties": "36bb0f2eccf4d8be971410c22818ba3f",
    "gazebo_msgs/ModelState": "9330fd35f2fcd82d457e54bd54e10593",
    "gazebo_msgs/ModelStates": "48c080191eb15c41858319b4d8a609c2",
    "gazebo_msgs/ODEPhysics": "667d56ddbd547918c32d1934503dc335",
    "gazebo_msgs/SetModelState": "5b3ab0281d4f5445def017e3a2e4a07b",
    "gazebo_msgs/SetPhysicsProperties": "97e2057080558ce4730434b5fae75c91",
    # As Debian 12's actionlib_msgs and move_base_msgs have them.
    "actionlib_msgs/GoalID": "302881f31927c1df708a2dbab0e80ee8",
    "actionlib_msgs/GoalStatus": "d388f9b87b3c471f784434d671988d4a",
    "move_base_msgs/MoveBaseActionGoal": "660d6895a1b9a16dce51fbdd9a64a56b",
    "move_base_msgs/MoveBaseActionResult": "1eb06eeff08fa7ea874431638cb52332",
    "std_srvs/Empty": "d41d8cd98f00b204e9800998ecf8427e",
    "geometry_msgs/PoseStamped": "d3812c3cbc69362b77dc0b19b345f8f5",
    "geometry_msgs/Twist": "9f195f881246fdfa2798d1d3eebca84a",
    "nav_msgs/OccupancyGrid": "3381f2d731d4076ec5c71b0759edbe4e",
    "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "robomaker_simulation_msgs/AddTags": "637781bbb7edf1a52e9fe238f1ba7d6b",
    "robomaker_simulation_msgs/Cancel": "937c9679a518e3a18d831e57125ea522",
    "robomaker_simulation_msgs/RemoveTags": "cae332c01603844d352ed026669010ee",
    "rosgraph_msgs/Clock": "a9c97c1d230cfc112e270351a944ee47",
    "sensor_msgs/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
    "sensor_msgs/CompressedImage": "8f7a12909da2c9d3332d540a0977563f",
    "sensor_msgs/Image": "060021388200f6f0f447d0fcd9c64743",
    "sensor_msgs/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/JointState": "3066dcd76a6cfaef579bd0f34173e9fd",
    "sensor_msgs/LaserScan": "90c7ef2dc6895d81024acba2ac42f369",
    "sensor_msgs/MagneticField": "2f3b0b43eed0c9501de0fa3ff89a45aa",
    "sensor_msgs/NavSatFix": "2d3a8cd499b9b4a0249fb98fd05cfa48",
    "sensor_msgs/NavSatStatus": "331cdbddfa4bc96ffc3b9ad98900a54c",
    "sensor_msgs/PointCloud2": "1158d486dd51d683ce2f1be655c3c181",
    "sensor_msgs/PointField": "268eacb2962780ceac86cbd17e328150",
    "sensor_msgs/Range": "c005c34273dc426c67a020a87bc24148",
    "sensor_msgs/RegionOfInterest": "bdb633039d588fcccb441a4d43ccfe09",
    "std_msgs/Header": "2176decaecbce78abc3b96ef049fabed",
    "std_msgs/UInt8MultiArray": "82373f1612381bb6ee473b5cd6f5d89c",
    "tf2_msgs/TFMessage": "94810edda583a504dfda3829e70d7eec",
}


@pytest.mark.parametrize("kind", PUBLISHED)
def test_the_digest_is_the_published_one(kind: str):
    assert type_digest(kind) == PUBLISHED[kind]


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_definition_parses_and_has_the_digest_of_its_type(kind: str):
    stores = pytest.importorskip("rosbags.typesys")
    package, name = kind.split("/")
    full = f"{package}/msg/{name}"
    store = stores.get_typestore(stores.Stores.EMPTY)
    store.register(stores.get_types_from_msg(definition(kind), full))
    assert store.generate_msgdef(full, ros_version=1)[1] == type_digest(kind)


@pytest.mark.parametrize("kind", SERVICES)
def test_a_service_is_no_message(kind: str):
    with pytest.raises(KeyError):
        definition(kind)


def test_a_type_that_the_robot_does_not_speak_has_no_digest():
    with pytest.raises(KeyError):
        type_digest("sensor_msgs/Joy")
