"""How sure one can be of a share: intervals from scipy."""

from specs.base import Spec


class Interval(Spec):
    """Two bounds, 0-1, the lower first."""

    lower: float
    upper: float


def wilson(successes: int, n: int, confidence: float) -> Interval:
    """Returns the two-sided score interval of a share (Wilson 1927, JASA 22:209), without continuity correction.

    Args:
        successes: 0 to ``n``.
        n: How many were counted; none says nothing, so the interval is then 0 to 1.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if not (0 <= successes <= n and 0.0 < confidence < 1.0):
        raise ValueError(f"{successes} successes of {n} with confidence {confidence}: 0 <= successes <= n, 0 < c < 1")
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    from scipy.stats import binomtest  # noqa: PLC0415 - takes a second to import, and most commands judge nothing

    bounds = binomtest(successes, n).proportion_ci(confidence, method="wilson")
    return Interval(lower=float(bounds.low), upper=float(bounds.high))
