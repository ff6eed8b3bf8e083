"""How ROS sees a robot follows from its bundle, and a robot that ROS could not drive is seen, too."""

from pathlib import Path

import numpy as np
import pytest

from specs.bundle_files import RosRobot
from tasks.simulate.replay.robot_view import robot_view
from tests.factories.simulations import REPOSITORY


def test_a_robot_that_declares_nothing_has_the_usual_names_and_its_controls_are_twists():
    robot, twists = robot_view(REPOSITORY / "applications/courier")
    assert robot == RosRobot()
    assert twists
    assert twists(np.array([[0.5, -1.0, 0.0]]), np.zeros(1))[0] == pytest.approx([0.5, 0.0, -1.0])


def test_a_robot_has_the_names_that_it_declares(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("topics: {scan: /front/scan}\n")
    assert robot_view(tmp_path).robot.topics.scan == "/front/scan"


def test_a_robot_without_a_drive_that_can_be_seen_has_no_twists(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("no declaration")
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    assert robot_view(tmp_path) == (RosRobot(), None)
