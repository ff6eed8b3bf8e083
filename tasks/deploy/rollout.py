"""Which robots start next, which never will, and when a roll-out is over: pure functions of what is known of each.

In flight at most ``max(1, floor(share x robots))``; ``ceil(threshold x robots)`` failures stop new starts, those in
flight finish, and the rest is aborted (semantics 8). When every robot has ended, both questions are always asked, so no
roll-out can end without a verdict.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal


class Phase(Enum):
    """Where a robot is in a roll-out; FAILED also stands for a robot that does not answer."""

    WAITING = "waiting"
    IN_FLIGHT = "in flight"
    IN_SYNC = "in sync"
    FAILED = "failed"
    ABORTED = "aborted"


@dataclass(frozen=True)
class Limits:
    """A roll-out's bounds, in robots.

    Attributes:
        at_once: How many may be in flight, at least 1.
        failures: How many failures stop it, at least 1.
    """

    at_once: int
    failures: int


@dataclass(frozen=True)
class Move:
    """What a controller does next.

    Attributes:
        start: Robots to ask now.
        abort: Robots that will not be asked.
        verdict: How the roll-out ended, or None while robots are waiting or in flight.
    """

    start: tuple[str, ...] = ()
    abort: tuple[str, ...] = ()
    verdict: Literal["Succeeded", "Failed"] | None = None


def limits(robots: int, *, concurrent_percent: int, threshold_percent: int) -> Limits:
    """Returns the bounds for a fleet of so many robots; percentages are from 1 to 100."""
    return Limits(
        at_once=max(1, robots * concurrent_percent // 100),
        failures=max(1, -(-robots * threshold_percent // 100)),
    )


def next_move(phases: Mapping[str, Phase], bounds: Limits) -> Move:
    """Returns what to do next for robots in these phases; robots start in the mapping's order."""
    waiting = tuple(robot for robot, phase in phases.items() if phase is Phase.WAITING)
    in_flight = sum(phase is Phase.IN_FLIGHT for phase in phases.values())
    failed = sum(phase is Phase.FAILED for phase in phases.values())
    aborted = any(phase is Phase.ABORTED for phase in phases.values())
    stopped = aborted or failed >= bounds.failures
    if not stopped and waiting:
        return Move(start=waiting[: max(0, bounds.at_once - in_flight)])
    if in_flight:
        return Move(abort=waiting)
    return Move(abort=waiting, verdict="Failed" if stopped else "Succeeded")
