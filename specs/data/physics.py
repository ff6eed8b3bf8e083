"""Physical parameters of a robot that episodes may vary, each as a factor of what its ``robot.xml`` says.

They stand among an episode's variables by names that no environment variable can have, so that matrices, searches,
tables and comparisons treat them as they treat variables. Applications do not see them: a robot does not know how heavy
it is. They enter a program as numbers, so that a sweep over them is one program.
"""

from collections.abc import Mapping
from typing import Literal

PhysicalName = Literal["robot.mass", "robot.friction", "robot.motorStrength"]
PHYSICAL: tuple[PhysicalName, ...] = ("robot.mass", "robot.friction", "robot.motorStrength")
LEAST_FACTOR, MOST_FACTOR = 0.1, 10.0


def physical_factors(environment: Mapping[str, str]) -> tuple[float, float, float] | None:
    """Returns the factors of an episode's mass, friction and motor strength; None where its variables name none."""
    if not any(name in environment for name in PHYSICAL):
        return None
    mass, friction, strength = (float(environment.get(name, "1")) for name in PHYSICAL)
    return mass, friction, strength


def application_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns the variables that applications see."""
    return {name: value for name, value in environment.items() if name not in PHYSICAL}
