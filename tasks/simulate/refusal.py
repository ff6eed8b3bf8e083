"""A robot that nothing can drive: apart from what reads robots, so that who only tells of it imports no MuJoCo."""

from specs.errors import SimyardError


class RobotRefused(SimyardError):  # noqa: N818 - a state
    """A robot.xml that does not load, or that an engine cannot represent; says which element, and the remedy."""
