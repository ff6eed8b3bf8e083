"""Whether the second of two batches is no worse than the first, by a margin."""

from typing import Literal

from specs.base import Spec
from tasks.results.compare.comparison import CommonEpisodes
from tasks.results.statistics.intervals import Interval, mcnemar, paired_difference

ComparisonAnswer = Literal["NO WORSE", "WORSE", "INCONCLUSIVE"]


class Comparison(Spec):
    """What two batches show about each other.

    Attributes:
        difference: Success rate of the second batch less that of the first, over the episodes that both have.
        interval: Of the difference (Tango 1998).
        p_value: Of McNemar's exact test: how likely flips as uneven as these are, were both equally good.
        margin: How much lower the second rate may be.
        answer: NO WORSE if the whole interval is above -margin, WORSE if it is below, else INCONCLUSIVE.
    """

    first: str
    second: str
    pairs: CommonEpisodes
    difference: float
    interval: Interval
    confidence: float
    p_value: float
    margin: float
    answer: ComparisonAnswer


def comparison(first: str, second: str, pairs: CommonEpisodes, *, margin: float, confidence: float) -> Comparison:
    """Returns what pairs of episodes show.

    Args:
        first: One batch.
        second: The other, which must be no worse.
        pairs: At least one.
        margin: How much lower its success rate may be, 0 to 1.
        confidence: Coverage of the interval, between 0 and 1.
    """
    interval = paired_difference(pairs.gains, pairs.losses, pairs.pairs, confidence)
    answer: ComparisonAnswer = "INCONCLUSIVE"
    if interval.lower > -margin:
        answer = "NO WORSE"
    elif interval.upper < -margin:
        answer = "WORSE"
    return Comparison(
        first=first,
        second=second,
        pairs=pairs,
        difference=(pairs.gains - pairs.losses) / pairs.pairs,
        interval=interval,
        confidence=confidence,
        p_value=mcnemar(pairs.gains, pairs.losses),
        margin=margin,
        answer=answer,
    )
