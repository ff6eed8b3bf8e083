"""A robot application and a scenario made into the program of an engine."""

from collections.abc import Callable
from pathlib import Path

from tasks.simulate.application.calls import Applications
from tasks.simulate.engine.choice import EngineChoice, EngineName
from tasks.simulate.engine.compiled_program import compiled_program
from tasks.simulate.engine.mjx.engine import mjx_mechanics
from tasks.simulate.engine.mujoco.engine import host_program
from tasks.simulate.engine.planar.engine import planar_mechanics
from tasks.simulate.engine.program import Program
from tasks.simulate.lane.step import Mechanics

_MECHANICS: dict[EngineName, Callable[[Path], Mechanics]] = {"planar": planar_mechanics, "mjx": mjx_mechanics}


def load_program(choice: EngineChoice, robot: Path, applications: Applications, lanes: int) -> Program:
    """Returns the program of a robot and its applications on the engine chosen for it; compiles nothing yet.

    Raises:
        RobotRefused: The engine cannot represent the robot.
    """
    if choice.engine == "mujoco":
        return host_program(robot, applications, lanes, plain=choice.plain)
    return compiled_program(_MECHANICS[choice.engine](robot), applications, lanes)
