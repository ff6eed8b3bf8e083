"""Intervals of many groups that hold all together.

Of forty intervals, each at 95 %, two miss by chance, and a reader looks at the worst group first. A family of intervals
shares what one may miss (Bonferroni): with any dependence between groups, all of them hold in at least as many reports
as the confidence says. The intervals are exact ones. Wilson's, at the confidence that each then needs, miss too often
near 1: docs/decisions/0032 has the figures.
"""

import math

from specs.base import Spec
from tasks.results.statistics.intervals import Interval


class IntervalFamily(Spec):
    """How many intervals a page shows or selects from, and how sure all of them together are.

    Attributes:
        size: How many there are; those of groups that are left out because others are worse count, too.
        confidence: How often all of them hold, between 0 and 1.
    """

    size: int
    confidence: float

    @property
    def each(self) -> float:
        """The confidence of each interval, such that all hold together (Dunn 1961, JASA 56:52)."""
        return 1.0 - (1.0 - self.confidence) / max(1, self.size)

    def interval(self, successes: int, n: int) -> Interval:
        """Returns the interval of one group's share.

        Args:
            successes: 0 to ``n``.
            n: How many were counted; none says nothing, so the interval is then 0 to 1.

        Raises:
            ValueError: The numbers are not such.
        """
        return clopper_pearson(successes, n, self.each)

    def sentence(self, of: str = "reports") -> str:
        """Returns how many intervals there are and what that means; empty of none.

        Args:
            of: What there are many of, if all is done again, such as ``reports``.
        """
        sure = f"{100 * self.confidence:g}\u00a0% of such {of}"
        if self.size < 2:
            return f"1 interval of a group; it holds in {sure}" if self.size else ""
        return f"{self.size:,} intervals of groups; all {self.size:,} hold together in {sure}"


def clopper_pearson(successes: int, n: int, confidence: float) -> Interval:
    """Returns the two-sided exact interval of a share (Clopper and Pearson 1934, Biometrika 26:404).

    It covers at least as often as asked for, whatever the share, and also where chances differ within a group, as they
    do between worlds: sums of unlike chances scatter less than those of equal ones (Hoeffding 1956, Annals of
    Mathematical Statistics 27:713).

    Args:
        successes: 0 to ``n``.
        n: How many were counted; none says nothing, so the interval is then 0 to 1.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if not (0 <= successes <= n and 0.0 < confidence < 1.0):
        raise ValueError(f"{successes} successes of {n} with confidence {confidence}: 0 <= successes <= n, 0 < c < 1")
    return Interval(lower=_lower(successes, n, confidence), upper=1.0 - _lower(n - successes, n, confidence))


def _lower(successes: int, n: int, confidence: float) -> float:
    if not successes:
        return 0.0
    from scipy.special import betaincinv  # noqa: PLC0415 - most commands judge nothing

    bound = float(betaincinv(successes, n - successes + 1, (1.0 - confidence) / 2.0))
    return math.floor(bound * 1e9) / 1e9
