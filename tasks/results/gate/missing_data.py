"""What a gate assumes of an episode that has no outcome to rely on: one table, from which rules and guide are made.

Missing data never helps: before a rule answers PASS it takes the worst for the tested version, before it answers FAIL
the best. Only what the robot did itself counts as what it is. To treat a case otherwise, change the table.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

from specs.data.episode import CANCELED
from specs.robomaker.simulation import SimulationJobErrorCode

ROBOTS_OWN: frozenset[SimulationJobErrorCode] = frozenset(
    {"RobotApplicationCrash", "RobotApplicationHealthCheckFailure"}
)
"""Failure codes that say what the robot's application did; all others say what happened to it."""

Gap = Literal["robot", "elsewhere", "canceled", "no result", "left out", "no value", "not passed"]
"""Why an episode has nothing to rely on: its job failed by the robot's own application or by something else, was
canceled, never got a row, was not needed any more; or it came to its end, but the value is none, or it did not pass."""

Assumption = Literal["best", "worst", "seen", "blocks", "uncounted"]
"""The best or the worst for the tested version, what was measured until then, that nothing is answered, or nothing."""

Rule = Literal["successRate", "noWorseThan", "other version", "collisionRate", "quantiles", "failed: worst"]


class Assumed(NamedTuple):
    """What is assumed before a rule answers PASS (proof), and before it answers FAIL (blame)."""

    proof: Assumption
    blame: Assumption


_EITHER = Assumed("worst", "best")
_BLOCKED = Assumed("blocks", "best")
_NOTHING = Assumed("uncounted", "uncounted")
_UNDRIVEN: Mapping[Gap, Assumed] = {"elsewhere": _EITHER, "canceled": _BLOCKED, "no result": _BLOCKED}
_QUANTILE: Mapping[Gap, Assumed] = {**_UNDRIVEN, "robot": _EITHER, "left out": _BLOCKED, "no value": _EITHER}
ASSUMED: Mapping[Rule, Mapping[Gap, Assumed]] = {
    "successRate": {**_UNDRIVEN, "robot": Assumed("worst", "worst"), "left out": _NOTHING},
    "noWorseThan": {**_UNDRIVEN, "robot": Assumed("worst", "worst"), "left out": _BLOCKED},
    # Of the version that it is compared with: the worst for the tested version is that this one passed.
    "other version": dict.fromkeys(("robot", "elsewhere", "canceled", "left out"), _EITHER),
    # A contact that was seen before the robot's application crashed is one.
    "collisionRate": {**_UNDRIVEN, "robot": Assumed("worst", "seen"), "left out": _NOTHING},
    # Of a measure that an early end makes better; other measures are what was measured.
    "quantiles": {**_QUANTILE, "not passed": Assumed("worst", "seen")},
    "failed: worst": {**_QUANTILE, "not passed": Assumed("worst", "worst")},
}
"""By rule and gap. What is not here cannot happen to that rule, or is what was measured."""


class Unseen(NamedTuple):
    """What rows do not show, as a rule takes it.

    Attributes:
        blocks: Whether it lets nothing pass.
        best: How many episodes more count as the best before a FAIL.
    """

    blocks: bool
    best: int


def gap_of(status: str, failure_code: str) -> Gap | None:
    """Returns why a job's episode has no outcome to rely on; None if it has one."""
    if status == CANCELED:
        return "canceled"
    if status == "Completed":
        return None
    return "robot" if failure_code in ROBOTS_OWN else "elsewhere"


def unseen(rule: Rule, counts: Mapping[Gap, int]) -> Unseen:
    """Returns what a rule takes episodes for that are not among its rows."""
    there = [(ASSUMED[rule][gap], count) for gap, count in counts.items() if count]
    blocks = any(assumed.proof == "blocks" for assumed, _ in there)
    return Unseen(blocks, sum(count for assumed, count in there if assumed.blame == "best"))


def codes_of(gap: Gap) -> list[SimulationJobErrorCode]:
    """Returns the failure codes that a failed job of that kind has, in RoboMaker's order."""
    return [code for code in get_args(SimulationJobErrorCode) if gap_of("Failed", code) == gap]
