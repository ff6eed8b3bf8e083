"""What a trend measures of each episode: whether it passed, whether it had no collision, or a column's quantile."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from specs.base import Fault, Spec
from specs.errors import DocumentError
from tasks.results.tables.history_rows import COLLISION, SUCCESS, measure_column

_ALLOWED = "success, collision, or a column and a quantile, such as simulated_s:0.95 or metrics.waiting_s:0.5"


class Measure(Spec):
    """What is measured.

    Attributes:
        column: ``success``, ``collision``, a column, or ``metrics.<name>``.
        quantile: Of the column, or None for the first two, which are shares.
    """

    column: str = SUCCESS
    quantile: float | None = None

    def words(self, at_most: float | None = None) -> str:
        """Returns what the rate is the share of; ``at_most`` is the value that a quantile is compared with."""
        if self.quantile is None:
            return "Success rate" if self.column == SUCCESS else "Episodes without a collision"
        return f"Episodes with {self.column} at most {at_most:.4g}"


def parse_measure(text: str) -> Measure:
    """Returns the measure that a text names.

    Raises:
        DocumentError: It names none.
    """
    column, colon, quantile = text.rpartition(":")
    if not colon and text in {SUCCESS, COLLISION}:
        return Measure(column=text)
    try:
        value = float(quantile)
    except ValueError:
        value = 0.0
    if not (0.0 < value < 1.0) or column in {SUCCESS, COLLISION} or not measure_column(column):
        raise DocumentError([Fault(path="--measure", value=repr(text), allowed=_ALLOWED)], source="simyard")
    return Measure(column=column, quantile=value)


def usual_value(nights: Sequence[Float[np.ndarray, " rows"]], quantile: float) -> float:
    """Returns what a quantile usually is: the median of the nights' own; NaN where nothing was measured.

    Args:
        nights: The values of each night's episodes; NaN where nothing was measured.
        quantile: Between 0 and 1.
    """
    measured = [values[~np.isnan(values)] for values in nights]
    own = [float(np.quantile(values, quantile)) for values in measured if len(values)]
    return float(np.median(own)) if own else float("nan")


def is_good(values: Float[np.ndarray, " rows"], at_most: float | None) -> Bool[np.ndarray, " rows"]:
    """Returns in which episodes all was well: it passed, had no collision, or stayed at the usual value or below."""
    return values > 0.5 if at_most is None else values <= at_most
