"""How an episode that ran ended: each reason with its meaning, its sign on maps and its colours, and the tags of it.

A reason is declared here once; charts, maps, pages and result tables read it from here.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from specs.data.episode import EpisodeResult

OutcomeReason = Literal[
    "",
    "collision",
    "timeout",
    "stuck",
    "out of bounds",
    "crash",
    "judged",
    "aborted",
    "canceled",
    "person",
    "robot",
    "deadlock",
]


# The order is the code that scenarios return: 1 is the first (docs/guide/applications.md); 0 says that the robot did
# its task. To add a reason, add its name to ``OutcomeReason`` and a record at the end of ``OUTCOME_REASONS``.
class Mark(NamedTuple):
    """How failures for a reason are drawn. Each colour stands out from its ground; hues as of Okabe and Ito (2008).

    Attributes:
        name: The mark's CSS class.
        glyph: SVG of its sign, in a box of 20 x 20.
        plan: Its colour on a floor plan.
        light: Its colour on a light page.
        dark: Its colour on a dark page.
        paper: Its colour in print.
    """

    name: str
    glyph: str
    plan: str
    light: str
    dark: str
    paper: str


class ReasonRecord(NamedTuple):
    """A reason why an episode did not pass.

    Attributes:
        name: As results have it.
        meaning: What happened, as a sentence.
        mark: How it is drawn; ``OTHER_MARK`` if it needs no sign of its own.
    """

    name: OutcomeReason
    meaning: str
    mark: Mark


_HIT = Mark("hit", '<path d="m4 4 12 12m0-12L4 16"/>', "#d55e00", "#c2410c", "#ff8f5c", "#c2410c")
_PERSON = Mark(
    "person",
    '<circle cx="10" cy="5.5" r="3"/><path d="M3.5 18c0-5 2.5-8 6.5-8s6.5 3 6.5 8"/>',
    "#8c510a",
    "#7a4700",
    "#d9a35c",
    "#7a4700",
)
_ROBOT = Mark(
    "robot", '<path d="M3.5 7h13v8h-13zM6.5 15v3m7-3v3M10 7V2.5"/>', "#d55e00", "#c2410c", "#ff8f5c", "#c2410c"
)
_LATE = Mark(
    "late",
    '<circle cx="10" cy="10" r="7.5"/><path d="M10 6v4.5h3.5" stroke-width="2.2"/>',
    "#0072b2",
    "#0068a8",
    "#6cb8f0",
    "#0068a8",
)
_STUCK = Mark("stuck", '<path d="M3.5 3.5h13v13h-13z"/>', "#cc79a7", "#a6337c", "#ec8cc7", "#a6337c")
_OUT = Mark("out", '<path d="M10 3 18 17H2z"/>', "#009e73", "#00735a", "#4fd0ae", "#00735a")
OTHER_MARK = Mark("other", '<path d="m10 2 8 8-8 8-8-8z"/>', "#5f6368", "#565d66", "#b4bcc6", "#444")
"""For whatever has no sign of its own: a crash, a failure code."""

OUTCOME_REASONS = (
    ReasonRecord("collision", "The robot touched something harder than the scenario allows.", _HIT),
    ReasonRecord("timeout", "The episode's duration was over.", _LATE),
    ReasonRecord("stuck", "The robot did not get on for longer than the scenario allows.", _STUCK),
    ReasonRecord("out of bounds", "The robot was outside the outer walls.", _OUT),
    ReasonRecord("crash", "An application failed, so that there is nothing to judge.", OTHER_MARK),
    ReasonRecord("judged", "The simulation application says that the robot did not do its task.", OTHER_MARK),
    ReasonRecord("aborted", "The navigation gave a goal up, or would not take it.", OTHER_MARK),
    ReasonRecord("canceled", "Somebody cancelled a goal of the navigation.", OTHER_MARK),
    ReasonRecord("person", "The robot touched a person harder than the scenario allows of anything.", _PERSON),
    ReasonRecord("robot", "The robot touched another robot harder than the scenario allows of anything.", _ROBOT),
    ReasonRecord(
        "deadlock", "The robot and another one beside it stood still until it was stuck, or too late.", _STUCK
    ),
)

REASON_CODES: tuple[OutcomeReason, ...] = ("", *(reason.name for reason in OUTCOME_REASONS))
"""By the code that a scenario's verdict holds."""

MARKS = (*dict.fromkeys(reason.mark for reason in OUTCOME_REASONS if reason.mark != OTHER_MARK), OTHER_MARK)
"""All marks, the one for anything else last."""

_MARK_OF: dict[str, Mark] = {reason.name: reason.mark for reason in OUTCOME_REASONS}


def mark_of(reason: str) -> Mark:
    """Returns how failures for a reason are drawn: an outcome's reason, a failure code, or a status."""
    return _MARK_OF.get(reason, OTHER_MARK)


OUTCOME, REASON = "simyard:outcome", "simyard:outcome-reason"
MOST_OWN_TAGS = 48
"""Of a simulation job: RoboMaker's 50 of a resource, without those of its outcome."""
_MOST_TAGS = 50
_RESERVED = "simyard:"


def is_reserved(key: str) -> bool:
    """Returns whether the key of a tag is Simyard's own, so that nobody else may set or remove it."""
    return key.lower().startswith(_RESERVED)


def outcome_tags(row: "EpisodeResult") -> dict[str, str]:
    """Returns the tags of a job that has ended with that result; none for one that was cancelled.

    A job that failed for a technical reason has not passed either: it says Failed, and its failure code.
    """
    from specs.data.episode import reason, success  # noqa: PLC0415 - a robot's agent needs this module, and no episode

    passed = success(row)
    if passed is None:
        return {}
    return {OUTCOME: "Passed"} if passed else failed_tags(reason(row))


def failed_tags(why: str) -> dict[str, str]:
    """Returns the tags of a job that has not passed, with its outcome's reason or its failure code."""
    return {OUTCOME: "Failed", REASON: why}


def with_outcome(own: Mapping[str, str], outcome: Mapping[str, str]) -> dict[str, str]:
    """Returns a job's own tags and those of its outcome, which win; a document's job may have had 50 of its own."""
    kept = [(key, value) for key, value in own.items() if key not in outcome]
    return {**dict(kept[: _MOST_TAGS - len(outcome)]), **outcome}
