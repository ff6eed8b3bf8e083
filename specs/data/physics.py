"""Physical parameters that episodes may vary: factors of a ``robot.xml``'s numbers, a delay, people, start and goals.

They stand among an episode's variables by names that no environment variable can have, so that matrices, searches,
tables and comparisons treat them as they treat variables. Applications do not see them: a robot does not know how heavy
it is. They enter a program as numbers, so that a sweep over them is one program.
"""

from collections.abc import Iterable, Iterator, Mapping
from math import pi
from typing import Literal, NamedTuple, cast

from specs.data.episode import CONTROL_HZ, CONTROL_S
from specs.data.people import LEAST_PACE_M_S, MOST_PACE_M_S, MOST_PEOPLE, People
from specs.rules import Finding, Location, items, part

PhysicalName = Literal[
    "robot.mass",
    "robot.friction",
    "robot.motorStrength",
    "robot.controlDelay_s",
    "people.count",
    "people.speed_ms",
    "people.unaware",
    "start.x_share",
    "start.y_share",
    "start.yaw_rad",
    "goals.x1_share",
    "goals.y1_share",
    "goals.x2_share",
    "goals.y2_share",
]
FACTORS: tuple[PhysicalName, ...] = ("robot.mass", "robot.friction", "robot.motorStrength")
CONTROL_DELAY: PhysicalName = "robot.controlDelay_s"
PEOPLE_COUNT: PhysicalName = "people.count"
OF_PEOPLE: tuple[PhysicalName, ...] = (PEOPLE_COUNT, "people.speed_ms", "people.unaware")
OF_START: tuple[PhysicalName, ...] = ("start.x_share", "start.y_share", "start.yaw_rad")
OF_GOALS: tuple[PhysicalName, ...] = ("goals.x1_share", "goals.y1_share", "goals.x2_share", "goals.y2_share")
PHYSICAL: tuple[PhysicalName, ...] = (*FACTORS, CONTROL_DELAY, *OF_PEOPLE, *OF_START, *OF_GOALS)
LEAST_FACTOR, MOST_FACTOR = 0.1, 10.0
MOST_DELAY_STEPS = 20
"""Control steps that a command may be on its way to the actuators; a reading of a sensor may be as old."""
_NEAR = 1e-6  # of a step: 0.15 s are no whole multiple of 0.05 s in binary


class Range(NamedTuple):
    """What a parameter may be.

    Attributes:
        least, most: Both are allowed.
        step: It is a whole multiple of that; 0 allows any number.
    """

    least: float
    most: float
    step: float = 0.0

    def has(self, value: object) -> bool:
        """Returns whether a raw value is one of them."""
        if not isinstance(value, int | float) or isinstance(value, bool):
            return False
        return self.least <= value <= self.most and abs(value - self.nearest(value)) <= _NEAR * self.step

    def nearest(self, value: float) -> float:
        """Returns the multiple of the step that is nearest to a value."""
        return round(value / self.step) * self.step if self.step else value

    def __str__(self) -> str:
        """Returns what is allowed, for a person."""
        multiple = f", a multiple of {self.step:g}" if self.step else ""
        return f"a number from {self.least:g} to {self.most:g}{multiple}"


RANGES: Mapping[PhysicalName, Range] = {
    **dict.fromkeys(FACTORS, Range(LEAST_FACTOR, MOST_FACTOR)),
    CONTROL_DELAY: Range(0.0, MOST_DELAY_STEPS * CONTROL_S, CONTROL_S),
    PEOPLE_COUNT: Range(1, MOST_PEOPLE, 1),
    "people.speed_ms": Range(LEAST_PACE_M_S, MOST_PACE_M_S),
    "people.unaware": Range(0.0, 1.0),
    "start.x_share": Range(0.0, 1.0),
    "start.y_share": Range(0.0, 1.0),
    "start.yaw_rad": Range(-pi, pi),
    **dict.fromkeys(OF_GOALS, Range(0.0, 1.0)),
}


def step_of(name: str) -> float:
    """Returns of what a variable is a whole multiple; 0 of one that may be any number."""
    return RANGES[name].step if name in PHYSICAL else 0.0


def beyond_range(physics: object, where: Location) -> Iterator[Finding]:
    """Yields the values of raw parameters, one each or a list each, that they may not have.

    Args:
        physics: Values by name.
        where: The place of the parameters in the document.
    """
    for name in cast("Mapping[str, object]", physics) if isinstance(physics, Mapping) else ():
        allowed, value = RANGES.get(cast("PhysicalName", name)), part(physics, name)
        if allowed is None:
            continue  # its type says so
        each = [((number,), one) for number, one in enumerate(items(value))] or [((), value)]
        numbers = ((place, one) for place, one in each if isinstance(one, int | float))  # of others their type says so
        yield from (
            Finding((*where, name, *place), one, str(allowed)) for place, one in numbers if not allowed.has(one)
        )


def physical_factors(environment: Mapping[str, str]) -> tuple[float, float, float] | None:
    """Returns the factors of an episode's mass, friction and motor strength; None where its variables name none."""
    if not any(name in environment for name in FACTORS):
        return None
    mass, friction, strength = (float(environment.get(name, "1")) for name in FACTORS)
    return mass, friction, strength


def control_delay_steps(environment: Mapping[str, str]) -> int | None:
    """Returns after how many control steps commands reach the actuators; None where an episode's variables say none."""
    text = environment.get(CONTROL_DELAY)
    return None if text is None else round(float(text) * CONTROL_HZ)


class VariedStart(NamedTuple):
    """Where an episode begins, whatever its scenario draws; None leaves that as it is.

    Attributes:
        x_share: Of the floor on which the robot can drive about from its scenario's start, what lies at smaller x.
        y_share: Of that of this x, what lies at smaller y.
        yaw_rad: Where it looks.
    """

    x_share: float | None
    y_share: float | None
    yaw_rad: float | None


def varied_start(environment: Mapping[str, str]) -> VariedStart | None:
    """Returns where an episode begins whose variables say so; None where they do not."""
    own = [environment.get(name) for name in OF_START]
    return VariedStart(*(None if each is None else float(each) for each in own)) if any(own) else None


GoalShares = tuple[tuple[float, float] | None, ...]
"""Of each goal, in order, which of the places that its scenario draws it from: a share along x and one along y; None
leaves it to the seed, as it does those that follow."""


def varied_goals(environment: Mapping[str, str]) -> GoalShares:
    """Returns the shares by which an episode's goals are drawn; empty where its variables say none.

    One share without the other is of the middle.
    """
    own = [environment.get(name) for name in OF_GOALS]
    if not any(own):
        return ()
    shares = [0.5 if each is None else float(each) for each in own]
    pairs = zip(own[::2], own[1::2], shares[::2], shares[1::2], strict=True)
    return tuple((x, y) if given_x or given_y else None for given_x, given_y, x, y in pairs)


def varied_people(people: People | None, environment: Mapping[str, str]) -> People | None:
    """Returns the people of an episode whose variables may say how many they are, and how they are."""
    own = {name.partition(".")[2]: float(environment[name]) for name in OF_PEOPLE if name in environment}
    if people is None or not own:
        return people
    return people.model_copy(update={**own, "count": round(own.get("count", people.count))})


def no_such_people(names: Iterable[str], people: object) -> Iterator[tuple[str, str]]:
    """Yields parameters of people that nobody has, and what is allowed instead.

    Args:
        names: Of all parameters, and others.
        people: Of the batch: how many, or a raw document; None for nobody.
    """
    for name in names:
        if name in OF_PEOPLE and people is None:
            yield name, "a batch with people: nobody walks in this one's worlds"
        elif name in OF_PEOPLE and name != PEOPLE_COUNT and part(people, "model") == "recorded":
            yield name, f"{PEOPLE_COUNT}: people who walk as they were recorded do so at their speed, whoever comes"


def application_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns the variables that applications see."""
    return {name: value for name, value in environment.items() if name not in PHYSICAL}
