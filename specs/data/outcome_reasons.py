"""Why an episode that ran did not pass: each reason with its meaning, its sign on maps and its colours.

The order is the code that scenarios return: 1 is the first (docs/guide/applications.md); 0 says that the robot did its
task. To add a reason, add its name to ``OutcomeReason`` and a record at the end of ``OUTCOME_REASONS``.
"""

from typing import Literal, NamedTuple

OutcomeReason = Literal["", "collision", "timeout", "stuck", "out of bounds", "crash"]


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
)

REASON_CODES: tuple[OutcomeReason, ...] = ("", *(reason.name for reason in OUTCOME_REASONS))
"""By the code that a scenario's verdict holds."""

MARKS = (*dict.fromkeys(reason.mark for reason in OUTCOME_REASONS if reason.mark != OTHER_MARK), OTHER_MARK)
"""All marks, the one for anything else last."""

_MARK_OF: dict[str, Mark] = {reason.name: reason.mark for reason in OUTCOME_REASONS}


def mark_of(reason: str) -> Mark:
    """Returns how failures for a reason are drawn: an outcome's reason, a failure code, or a status."""
    return _MARK_OF.get(reason, OTHER_MARK)
