"""Whether two episodes failed in the same way, or had failures of one kind."""

from math import dist
from typing import NamedTuple

from specs.data.episode import EpisodeResult

# A robot's own length or two: nearer ends are one place of an apartment, such as a corner of a table.
SAME_PLACE_M = 1.0


class Ending(NamedTuple):
    """How an episode ended.

    Attributes:
        row: What came of it.
        goal_m: Where the robot was to go then (x, y); None where that is not known, as of an episode that never began.
    """

    row: EpisodeResult
    goal_m: tuple[float, float] | None = None

    @property
    def place_m(self) -> tuple[float, float]:
        """Returns where the robot was (x, y)."""
        return self.row.final_x_m, self.row.final_y_m


def is_of_same_kind(first: Ending, other: Ending) -> bool:
    """Returns whether status, failure code and outcome reason are the same."""
    return _kind(first.row) == _kind(other.row)


def is_same_failure(first: Ending, other: Ending) -> bool:
    """Returns whether it is the same failure: of one kind, on the way to the same goal, and in the same place.

    Goals are the same if they are the same in order and lie within ``SAME_PLACE_M``: furniture that is gone leaves
    scenarios another floor to draw them on. Places are the same if they lie within ``SAME_PLACE_M``.
    """
    return (
        is_of_same_kind(first, other)
        and is_same_goal(first, other)
        and dist(first.place_m, other.place_m) <= SAME_PLACE_M
    )


def is_same_goal(first: Ending, other: Ending) -> bool:
    """Returns whether two robots were on the way to the same goal."""
    if first.row.goals_reached != other.row.goals_reached:
        return False
    if first.goal_m is None or other.goal_m is None:
        return first.goal_m == other.goal_m
    return dist(first.goal_m, other.goal_m) <= SAME_PLACE_M


def _kind(row: EpisodeResult) -> tuple[str, str, str]:
    return row.status, row.failure_code, row.outcome_reason
