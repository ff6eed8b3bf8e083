"""Answers hold as much as a store can, where RoboMaker's lists ended."""

from specs.robomaker.deployment import DescribeFleetResponse, Robot


def test_a_fleet_of_more_robots_than_a_list_had_can_be_described():
    robots = (Robot(name="r"),) * 1001

    assert len(DescribeFleetResponse(robots=robots).robots or ()) == 1001
