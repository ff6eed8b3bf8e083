"""Topics that nodes want and give, read from their programs."""

from pathlib import Path

import pytest

from tasks.ros.launch.launch_plan import NodePlan
from tasks.ros.launch.node_topics import NodeTopics, TypedTopic, WantedTopic, node_topics, unlike, unpublished

_ROS1 = """#!/usr/bin/env python3
import rospy
rospy.Subscriber("scan", Scan, print)
rospy.Subscriber(name="/amcl_pose", data_class=Pose)
rospy.wait_for_message("~start", Empty)
rospy.Subscriber(computed, Scan)
goals = rospy.Publisher("goal", Pose, queue_size=1)
"""
_ROS2 = """#!/usr/bin/env python3
class Roam(Node):
    def __init__(self):
        self.create_subscription(Scan, "scan", self.see, 1)
        self.out = self.create_publisher(Twist, "cmd_vel", 1)
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """The program of a node in a bundle."""
    return tmp_path / "roam.py"


def read(program: Path, text: str, *words: str, namespace: str = "/") -> NodeTopics:
    program.write_text(text)
    command = (str(program), *words, "__name:=roam")
    node = NodePlan(f"{namespace}roam", "roamer", "roam.py", command, namespace=namespace)
    return node_topics(node, program.parent)


def test_names_that_stand_there_are_known(program: Path) -> None:
    found = read(program, _ROS1)
    assert found == NodeTopics(("/scan", "/amcl_pose", "/roam/start"), ("/goal",), known=True)
    assert read(program, _ROS2) == NodeTopics(("/scan",), ("/cmd_vel",), known=True)


def test_remappings_and_namespaces_count_as_in_ros(program: Path) -> None:
    found = read(program, _ROS1, "scan:=/front", "goal:=plan/goal", namespace="/robot/")
    assert found.wants == ("/front", "/amcl_pose", "/robot/roam/start")
    assert found.gives == ("/robot/plan/goal",)


def test_a_function_that_a_package_of_ros_2_runs_is_read_in_its_module(program: Path) -> None:
    package = program.parent / "roam"
    package.mkdir()
    (package / "drive.py").write_text(_ROS2.partition("\n")[2])
    call = "import sys; sys.argv[0] = 'roam'; from roam.drive import main; sys.exit(main())"
    command = ("/usr/bin/python3", "-c", call, "--ros-args", "-r", "scan:=front")
    node = NodePlan("/roam", "roam", "roam", command, environment=(("PYTHONPATH", f"/opt/ros:{program.parent}"),))
    assert node_topics(node, program.parent) == NodeTopics(("/front",), ("/cmd_vel",), known=True)


@pytest.mark.parametrize("text", ["\x7fELF", "#!/bin/sh\n", "#!/usr/bin/env python\nprint 'old'\n"])
def test_a_program_that_nobody_reads_may_publish_anything(program: Path, text: str) -> None:
    assert read(program, text) == NodeTopics()


def test_topics_without_a_publisher_are_told_with_who_may_publish_them() -> None:
    wanted = [WantedTopic(node="/roam (roamer roam.py)", topic=topic) for topic in ("/scan", "/map")]
    said = "/roam (roamer roam.py) wants /map, which nobody publishes"
    assert list(unpublished(wanted, ["/scan"], [])) == [said]
    assert list(unpublished(wanted, ["/scan"], ["/amcl (amcl amcl)"])) == [f"{said}, unless /amcl (amcl amcl) does"]


def test_a_topic_that_is_published_in_another_namespace_is_named_with_what_to_do() -> None:
    wanted = [WantedTopic(node="/roam (roamer roam.py)", topic="/scan")]
    (line,) = unpublished(wanted, ["/clock", "/robot/scan"], [])
    assert line.endswith("nobody publishes: /robot/scan is published; remap it, or name /scan among topics in ros.yaml")


def test_a_sensor_that_a_robot_may_have_is_named() -> None:
    wanted = [WantedTopic(node="/see (courier see.py)", topic="/camera/depth/points")]
    (line,) = unpublished(wanted, ["/scan"], [], {"/camera/depth/points": "depth_camera"})
    said = "/see (courier see.py) wants /camera/depth/points, which nobody publishes"
    assert line == f"{said}: ros.yaml may declare depth_camera"


def test_types_that_stand_there_are_known_and_no_others(program: Path) -> None:
    text = """#!/usr/bin/env python3
import nav_msgs.msg
from sensor_msgs.msg import LaserScan as Scan, Imu
from other_msgs.msg import Imu
self.create_subscription(Scan, "scan", self.see, 1)
self.create_subscription(nav_msgs.msg.Odometry, "odom", self.see, 1)
self.create_subscription(Imu, "imu", self.see, 1)
self.create_subscription(computed(), "map", self.see, 1)
rospy.Publisher("twice", Scan)
self.create_publisher(nav_msgs.msg.Path, "twice", 1)
rospy.Publisher(name="seen", data_class=Scan)
"""
    found = read(program, text)
    assert found.wanted_types == {"/scan": "sensor_msgs/LaserScan", "/odom": "nav_msgs/Odometry"}
    assert (found.gives, found.given_types) == (("/twice", "/seen"), {"/seen": "sensor_msgs/LaserScan"})


def test_who_writes_a_topic_with_a_type_that_another_one_does_not_read_is_told() -> None:
    twists = ("geometry_msgs/Twist", "geometry_msgs/TwistStamped")
    reads = [TypedTopic(node="the robot", topic="/cmd_vel", types=twists)]
    writes = [
        TypedTopic(node=f"/{kind}", topic=topic, types=(f"geometry_msgs/{kind}",))
        for kind, topic in (("TwistStamped", "/cmd_vel"), ("Vector3", "/cmd_vel"), ("Pose", "/goal"))
    ]
    assert list(unlike(reads, writes)) == [
        "/Vector3 publishes /cmd_vel as geometry_msgs/Vector3, and the robot reads it as geometry_msgs/Twist or "
        "geometry_msgs/TwistStamped: it does not arrive; give both one type"
    ]
