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


_WORDS: Mapping[Rule, Mapping[Assumption, str]] = {
    "successRate": {"best": "passed", "worst": "failed"},
    "noWorseThan": {"best": "passed", "worst": "failed"},
    "other version": {"best": "failed", "worst": "passed"},
    "collisionRate": {"best": "no contact", "worst": "a contact", "seen": "what was seen"},
    "quantiles": {"best": "the best value", "worst": "the worst value", "seen": "as measured"},
    "failed: worst": {"best": "the best value", "worst": "the worst value"},
}
_HEADS: Mapping[Rule, str] = {
    "noWorseThan": "`noWorseThan`, tested version",
    "other version": "`noWorseThan`, other version",
    "failed: worst": "`quantiles`, `failed: worst`",
}
_CASES: Mapping[Gap, str] = {
    "robot": "Failed, the robot's own code",
    "elsewhere": "Failed, any other code",
    "canceled": "Canceled, with any code or none",
    "no result": "no row: it never ran",
    "left out": "left out by an early end",
    "no value": "Completed, the column is empty or no number",
    "not passed": "Completed, not passed",
}


def rows_of_guide() -> list[list[str]]:
    """Returns the table as docs/guide/gate.md has it: a row for each case, in each cell what PASS and FAIL assume."""
    rules = list(ASSUMED)
    head = ["an episode that is", *(_HEADS.get(rule, f"`{rule}`") for rule in rules)]
    return [head, *([_CASES[gap], *(_cell(rule, gap) for rule in rules)] for gap in get_args(Gap))]


def codes_line() -> str:
    """Returns which failure codes are the robot's own and which are not, as docs/guide/gate.md has it."""
    own, others = (", ".join(f"`{code}`" for code in codes_of(gap)) for gap in ("robot", "elsewhere"))
    return f"The robot's own codes are {own}. Any other code is one of {others}."


def codes_of(gap: Gap) -> list[SimulationJobErrorCode]:
    """Returns the failure codes that a failed job of that kind has, in RoboMaker's order."""
    return [code for code in get_args(SimulationJobErrorCode) if gap_of("Failed", code) == gap]


def _cell(rule: Rule, gap: Gap) -> str:
    assumed = ASSUMED[rule].get(gap)
    if assumed is None:
        return "-"
    if assumed == _NOTHING:
        return "not counted"
    words: Mapping[Assumption, str] = {"blocks": "no PASS", **_WORDS[rule]}
    proof, blame = words[assumed.proof], words[assumed.blame]
    return proof if proof == blame else f"{proof} / {blame}"
