"""What ros.yaml may say."""

import pytest
from pydantic import ValidationError

from specs.ros_robot import OWN_TOPICS, RosRobot, RosTopics
from tasks.ros.bag.track_log import track_channels
from tests.ros.bag.tracks import with_twist

FIELDS = tuple(RosTopics.model_fields)


@pytest.mark.parametrize("topic", sorted(OWN_TOPICS))
def test_a_topic_of_every_robot_or_recording_is_nothing_else(topic: str):
    with pytest.raises(ValidationError, match=f"odometry: {topic} is a topic of every robot"):
        RosTopics(odometry=topic)


def test_two_sensors_do_not_share_a_topic():
    with pytest.raises(ValidationError, match="scan and goal are both /goal"):
        RosTopics(scan="/goal", goal="/goal")


@pytest.mark.parametrize("scan", ["/range_1", "/camera/color/image_raw/compressed"])
def test_a_topic_whose_name_is_made_of_another_is_nothing_else(scan: str):
    sensors = {"range_finders": {"finders": 2}, "color_camera": {}}
    with pytest.raises(ValidationError, match=f"topics: {scan} is made of one of its names"):
        RosRobot.model_validate({"topics": {"scan": scan}, **sensors})


@pytest.mark.parametrize("name", ["range_finders", "gps", "lidar", "imu"])
def test_several_sensors_of_a_kind_are_refused(name: str):
    with pytest.raises(ValidationError, match=f"{name}\\n.*a robot has one sensor of this kind"):
        RosRobot.model_validate({name: [{}, {}]})


@pytest.mark.parametrize("topic", ["/tf", "/laser"])
def test_what_the_robot_itself_says_is_not_recorded_again(topic: str):
    with pytest.raises(ValidationError, match=f"record: {topic} is a topic of the robot"):
        RosRobot(topics=RosTopics(scan="/laser"), record={topic: "tf2_msgs/TFMessage"})
    assert RosRobot(record={"/map": "nav_msgs/OccupancyGrid"}).record


def test_the_map_may_be_called_as_it_usually_is():
    assert RosTopics(floor_map="/map").floor_map == "/map"


def test_recordings_have_no_topics_besides_the_robots_and_their_own():
    topics = RosTopics(**{field: f"/of/{field}" for field in FIELDS})
    recorded = {channel.topic for channel in track_channels(with_twist()._replace(topics=topics))}
    assert recorded <= OWN_TOPICS | set(topics.model_dump().values())


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ([{}], "a list of cameras has 2 to 8"),
        ([{}, "front"], "a list of cameras has 2 to 8"),
        ([{"name": f"eye_{number}"} for number in range(9)], "others\n.*at most 7 items"),
        ([{}, {}], "each camera of a list has one of its own"),
        ([{"name": "front"}, {"name": "front"}], "each camera of a list has one of its own"),
        ([{"name": "Front"}, {"name": "rear"}], "name\n.*should match pattern"),
        ([{"name": "front"}, {"name": "rear", "columns": 8}], "columns: cameras of a list have the same"),
        ([{"name": "front"}, {"name": "rear", "x": 8}], "others.0.x\n"),
    ],
)
def test_a_list_of_cameras_that_cannot_be_is_refused(cameras: list[object], message: str):
    for name in ("depth_camera", "color_camera"):
        with pytest.raises(ValidationError, match=message):
            RosRobot.model_validate({name: cameras})


def test_topics_of_cameras_in_a_list_have_their_names_and_are_nothing_else():
    cameras = [{"name": "front"}, {"name": "rear"}]
    robot = RosRobot.model_validate({"depth_camera": cameras})
    assert robot.depth_camera
    assert [each.own("/points") for each in robot.depth_camera.every] == ["/front/points", "/rear/points"]
    assert [each.own("eye") for each in robot.depth_camera.every] == ["front_eye", "rear_eye"]
    with pytest.raises(ValidationError, match="/rear/camera/depth/points is"):
        RosRobot.model_validate({"depth_camera": cameras, "topics": {"scan": "/rear/camera/depth/points"}})
