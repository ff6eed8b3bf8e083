"""Fleets and robots: RoboMaker's requests and answers."""

from typing import Annotated

from pydantic import Field

from specs.base import Spec
from specs.field_types import Architecture, Arn, CreatedAt, FilteredPage, Id, Name, PaginationToken, RobotTagMap, TagMap
from specs.robomaker.deployment import DeploymentStatus, RobotStatus


class CreateFleetRequest(Spec):
    """Asks for a fleet."""

    name: Name
    tags: TagMap | None = None


class CreateFleetResponse(Spec):
    """The fleet that was made."""

    arn: Arn | None = None
    name: Name | None = None
    createdAt: CreatedAt | None = None
    tags: TagMap | None = None


class CreateRobotRequest(Spec):
    """Asks for a robot."""

    name: Name
    architecture: Architecture
    greengrassGroupId: Id
    tags: RobotTagMap | None = None


class CreateRobotResponse(Spec):
    """The robot that was made."""

    arn: Arn | None = None
    name: Name | None = None
    createdAt: CreatedAt | None = None
    greengrassGroupId: Id | None = None
    architecture: Architecture | None = None
    tags: TagMap | None = None


class RegisterRobotRequest(Spec):
    """Asks for a robot to join a fleet."""

    fleet: Arn
    robot: Arn


class RegisterRobotResponse(Spec):
    """The fleet and the robot that joined it."""

    fleet: Arn | None = None
    robot: Arn | None = None


class DeregisterRobotRequest(Spec):
    """Asks for a robot to leave a fleet."""

    fleet: Arn
    robot: Arn


class DeregisterRobotResponse(Spec):
    """The fleet and the robot that left it."""

    fleet: Arn | None = None
    robot: Arn | None = None


class DeleteFleetRequest(Spec):
    """Asks for a fleet to be deleted."""

    fleet: Arn


class DeleteFleetResponse(Spec):
    """Says nothing."""


class DeleteRobotRequest(Spec):
    """Asks for a robot to be deleted."""

    robot: Arn


class DeleteRobotResponse(Spec):
    """Says nothing."""


class DescribeFleetRequest(Spec):
    """Asks about a fleet."""

    fleet: Arn


class Robot(Spec):
    """A robot of a fleet; RoboMaker spelt the Greengrass group differently here."""

    arn: Arn | None = None
    name: Name | None = None
    fleetArn: Arn | None = None
    status: RobotStatus | None = None
    greenGrassGroupId: Id | None = None
    createdAt: CreatedAt | None = None
    architecture: Architecture | None = None
    lastDeploymentJob: Arn | None = None
    lastDeploymentTime: CreatedAt | None = None


Robots = tuple[Robot, ...]
"""The interface says at most 1000: a fleet that has more is not cut off."""


class Fleet(Spec):
    """A fleet in a list."""

    name: Name | None = None
    arn: Arn | None = None
    createdAt: CreatedAt | None = None
    lastDeploymentStatus: DeploymentStatus | None = None
    lastDeploymentJob: Arn | None = None
    lastDeploymentTime: CreatedAt | None = None


class DescribeFleetResponse(Fleet):
    """A fleet and its robots."""

    robots: Robots | None = None
    tags: TagMap | None = None


class DescribeRobotRequest(Spec):
    """Asks about a robot."""

    robot: Arn


class DescribeRobotResponse(Spec):
    """A robot."""

    arn: Arn | None = None
    name: Name | None = None
    fleetArn: Arn | None = None
    status: RobotStatus | None = None
    greengrassGroupId: Id | None = None
    createdAt: CreatedAt | None = None
    architecture: Architecture | None = None
    lastDeploymentJob: Arn | None = None
    lastDeploymentTime: CreatedAt | None = None
    tags: TagMap | None = None


class ListFleetsRequest(FilteredPage):
    """Asks for the fleets."""


class ListFleetsResponse(Spec):
    """A page of fleets."""

    fleetDetails: Annotated[tuple[Fleet, ...], Field(max_length=200)] | None = None
    nextToken: PaginationToken | None = None


class ListRobotsRequest(FilteredPage):
    """Asks for the robots."""


class ListRobotsResponse(Spec):
    """A page of robots."""

    robots: Robots | None = None
    nextToken: PaginationToken | None = None
