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


@pytest.mark.parametrize("name", ["depth_camera", "color_camera", "lidar", "imu"])
def test_several_sensors_of_a_kind_are_refused(name: str):
    with pytest.raises(ValidationError, match=f"{name}\\n.*a robot has one sensor of a kind"):
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
