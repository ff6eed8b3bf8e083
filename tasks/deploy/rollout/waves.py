"""The rules of a roll-out: which robots start next, which never will, and when it is over. Pure functions.

In flight at most ``max(1, floor(share x robots))``; ``ceil(threshold x robots)`` failures stop new starts, those in
flight finish, and the rest is aborted (docs/reference/robomaker.md, section 8). When every robot has ended, both
questions are always asked, so no roll-out can end without a verdict.

Beyond RoboMaker: canaries go first, and one failure among them stops everything; failures may be made to count only
after so many robots have ended (Greengrass calls that the minimum number of executed things); an operator may pause
a roll-out, or cancel it.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

Wish = Literal["go", "pause", "cancel", "time out"]
"""What is wanted of a roll-out; ``time out`` when the fleet's time is over."""


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
        canaries: How many robots, the fleet's first, must be in sync before any other starts.
        least_ended: How many robots must have ended before failures stop it.
    """

    at_once: int
    failures: int
    canaries: int = 0
    least_ended: int = 0


@dataclass(frozen=True)
class Move:
    """What a controller does next.

    Attributes:
        start: Robots to ask now.
        abort: Robots that will not be asked.
        verdict: How the roll-out ended, or None while robots are waiting or in flight.
        why: What stopped it, where it was stopped.
    """

    start: tuple[str, ...] = ()
    abort: tuple[str, ...] = ()
    verdict: Literal["Succeeded", "Failed", "Canceled"] | None = None
    why: Literal["", "threshold", "canary", "time", "canceled"] = ""


def limits(robots: int, *, concurrent_percent: int, threshold_percent: int) -> Limits:
    """Returns the bounds for a fleet of so many robots; percentages are from 1 to 100."""
    return Limits(
        at_once=max(1, robots * concurrent_percent // 100),
        failures=max(1, -(-robots * threshold_percent // 100)),
    )


def next_move(phases: Mapping[str, Phase], bounds: Limits, wish: Wish = "go") -> Move:
    """Returns what to do next for robots in these phases; robots start in the mapping's order.

    Args:
        phases: Where each robot is, in the fleet's order.
        bounds: What the roll-out keeps to.
        wish: What is wanted of it; paused, it starts no robot, and ends only when none is left to start.
    """
    waiting = tuple(robot for robot, phase in phases.items() if phase is Phase.WAITING)
    in_flight = sum(phase is Phase.IN_FLIGHT for phase in phases.values())
    why = _stopped_by(phases, bounds, wish)
    if why:
        # Those that were asked finish: half an installation is worse than the wrong one.
        verdict = None if in_flight else "Canceled" if why == "canceled" else "Failed"
        return Move(abort=waiting, verdict=verdict, why=why)
    if waiting and wish == "pause":
        return Move()
    if waiting:
        return Move(start=_allowed(phases, bounds, waiting)[: max(0, bounds.at_once - in_flight)])
    return Move() if in_flight else Move(verdict="Succeeded")


def _stopped_by(
    phases: Mapping[str, Phase], bounds: Limits, wish: Wish
) -> Literal["", "threshold", "canary", "time", "canceled"]:
    """Returns what stops a roll-out; nothing while it may go on."""
    count = Counter(phases.values())
    left = count[Phase.WAITING] + count[Phase.IN_FLIGHT]
    enough = not left or count[Phase.IN_SYNC] + count[Phase.FAILED] >= bounds.least_ended
    if wish == "cancel":
        return "canceled"
    if any(phase is Phase.FAILED for phase in _canaries(phases, bounds)):
        return "canary"
    if count[Phase.FAILED] >= bounds.failures and enough:
        return "threshold"
    if wish == "time out" and (count[Phase.WAITING] or count[Phase.ABORTED]):
        return "time"
    # Somebody was left out before: whatever it was for, it stays so.
    return "threshold" if count[Phase.ABORTED] else ""


def _allowed(phases: Mapping[str, Phase], bounds: Limits, waiting: tuple[str, ...]) -> tuple[str, ...]:
    """Returns which of the waiting robots may start: canaries alone until all of them are in sync."""
    if all(phase is Phase.IN_SYNC for phase in _canaries(phases, bounds)):
        return waiting
    return tuple(robot for robot in list(phases)[: bounds.canaries] if phases[robot] is Phase.WAITING)


def _canaries(phases: Mapping[str, Phase], bounds: Limits) -> list[Phase]:
    return list(phases.values())[: bounds.canaries]
