"""A graph beside which programs of a real ROS run, where there is one."""

from pathlib import Path

import pytest

from tasks.ros.launch.packages import RosInstallation
from tests.ros.graph.episode import Episode
from tests.ros.graph.noetic.ros_episode import RosEpisode


@pytest.fixture
def noetic(ros: RosInstallation, episode: Episode, tmp_path: Path) -> RosEpisode:
    """The graph, and an environment in which ROS's programs find it."""
    assert not ros.missing
    return RosEpisode(episode, tmp_path)
