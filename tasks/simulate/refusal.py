"""The refusals of a robot; in a module of its own, so that who only reports them imports no MuJoCo."""

from specs.errors import SimyardError


class RobotRefused(SimyardError):  # noqa: N818 - a state
    """A robot.xml that does not load, or that an engine cannot represent; says which element, and the remedy."""


class MjcfRefused(RobotRefused):
    """A robot.xml that MuJoCo is not given: it leads out of its bundle, or grows beyond any robot."""
