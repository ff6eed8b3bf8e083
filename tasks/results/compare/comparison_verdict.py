"""Whether the second of two batches is no worse than the first, by a margin."""

from typing import Literal

from specs.base import Spec
from tasks.results.compare.comparison import CommonEpisodes
from tasks.results.statistics.intervals import Interval, mcnemar, paired_difference
from tasks.results.statistics.rate_text import in_worlds
from tasks.results.statistics.worlds.difference_over_worlds import difference_over_worlds
from tasks.results.statistics.worlds.refusal import why_refused

ComparisonAnswer = Literal["NO WORSE", "WORSE", "INCONCLUSIVE"]


class Comparison(Spec):
    """What two batches show about each other.

    Attributes:
        difference: Success rate of the second batch less that of the first, over the episodes that both have.
        interval: Of the difference in these worlds (Tango 1998).
        over_worlds: Of the difference in worlds like these; None where nothing is said of it.
        refused: Why nothing is said of it; else empty.
        p_value: Of McNemar's exact test: how likely flips as uneven as these are, were both equally good.
        margin: How much lower the second rate may be.
        answer: NO WORSE if the whole interval is above -margin, WORSE if it is below, else INCONCLUSIVE; in these
            worlds.
        answer_over_worlds: The same of worlds like these; None where nothing is said of them.
    """

    first: str
    second: str
    pairs: CommonEpisodes
    difference: float
    interval: Interval
    over_worlds: Interval | None
    refused: str
    confidence: float
    p_value: float
    margin: float
    answer: ComparisonAnswer
    answer_over_worlds: ComparisonAnswer | None

    def where(self) -> str:
        """Returns in which worlds the rates, the difference and the answer hold, in words."""
        return in_worlds(len(self.pairs.by_world))

    def elsewhere(self) -> str:
        """Returns the other worlds that they may be asked of, in words: those like these."""
        return in_worlds(len(self.pairs.by_world), like_these=True)


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
    counts = [(each.gains, each.losses, each.pairs) for each in pairs.by_world]
    refused = why_refused("difference", len(counts))
    gains, losses, n = ([each[at] for each in counts] for at in range(3))
    over_worlds = None if refused else difference_over_worlds(gains, losses, n, confidence)
    return Comparison(
        first=first,
        second=second,
        pairs=pairs,
        difference=(pairs.gains - pairs.losses) / pairs.pairs,
        interval=interval,
        over_worlds=over_worlds,
        refused=refused,
        confidence=confidence,
        p_value=mcnemar(pairs.gains, pairs.losses),
        margin=margin,
        answer=_answer(interval, margin),
        answer_over_worlds=_answer(over_worlds, margin) if over_worlds else None,
    )


def _answer(interval: Interval, margin: float) -> ComparisonAnswer:
    if interval.lower > -margin:
        return "NO WORSE"
    return "WORSE" if interval.upper < -margin else "INCONCLUSIVE"
