"""The refusal of a robot; in a module of its own, so that who only reports it imports no MuJoCo."""

from specs.errors import SimyardError


class RobotRefused(SimyardError):  # noqa: N818 - a state
    """A robot.xml that does not load, or that an engine cannot represent; says which element, and the remedy."""
