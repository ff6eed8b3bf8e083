"""A test of a share that may be looked at after every episode, and stopped at any look: its error rate holds anyway.

An interval that is computed again and again while episodes come in, and acted upon as soon as it is clear of the bar,
errs far more often than its confidence says. What may be looked at is an e-process: a bet against the hypothesis whose
capital is expected not to grow while the hypothesis holds, so that it ever reaches 1 / alpha with probability alpha at
most (Ville 1939, Etude critique de la notion de collectif). Here the bet is spread over all alternatives beyond the
bar (the method of mixtures: Robbins 1970, Annals of Mathematical Statistics 41:1397; for counts, Howard, Ramdas,
McAuliffe and Sekhon 2021, Annals of Statistics 49:1055; as betting, Waudby-Smith and Ramdas 2024, JRSS B 86:1), with
Jeffreys' beta distribution cut off at the bar, which has a closed form.

It holds for episodes that are independent of one another given the past, in any order that was fixed before they ran,
each with the same chance; where chances differ by world, the order has to be shuffled so that whoever comes first
stands for all (``tasks.simulate.plan.episode_layout``). A test shows that it then errs no more often.
"""

import math

from tasks.results.statistics.intervals import Interval

_PRIOR = 0.5
_DIGITS = 1e9


def log_capital_above(successes: int, n: int, bar: float) -> float:
    """Returns the logarithm of the capital of a bet that the share is above the bar, against that it is not.

    Args:
        successes: Of the episodes so far.
        n: How many there were.
        bar: The share, above 0 and below 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if not (0 <= successes <= n and 0.0 < bar < 1.0):
        raise ValueError(f"{successes} successes of {n} against a share of {bar}: 0 <= successes <= n, 0 < bar < 1")
    from scipy.special import betaln  # noqa: PLC0415 - most commands judge nothing
    from scipy.stats import beta  # noqa: PLC0415

    failures = n - successes
    prior = betaln(_PRIOR, _PRIOR) + beta.logsf(bar, _PRIOR, _PRIOR)
    after = betaln(_PRIOR + successes, _PRIOR + failures) + beta.logsf(bar, _PRIOR + successes, _PRIOR + failures)
    return float(after - prior) - successes * math.log(bar) - failures * math.log1p(-bar)


def log_capital_below(successes: int, n: int, bar: float) -> float:
    """Returns the logarithm of the capital of a bet that the share is below the bar, against that it is not."""
    return log_capital_above(n - successes, n, 1.0 - bar)


def confidence_sequence(successes: int, n: int, confidence: float) -> Interval:
    """Returns the interval that holds the share at all looks together with at least that confidence.

    Its lower bound is at a bar exactly when the bet that the share is above has grown to 2 / (1 - confidence), and
    its upper bound likewise.

    Args:
        successes: Of the episodes so far.
        n: How many there were; none says nothing.
        confidence: Coverage, between 0 and 1.
    """
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    enough = math.log(2.0 / (1.0 - confidence))
    return Interval(
        lower=_lower(successes, n, enough),
        upper=round(1.0 - _lower(n - successes, n, enough), 9),
    )


def _lower(successes: int, n: int, enough: float) -> float:
    """Returns the highest share below the estimate that so much capital speaks against, rounded down."""
    from scipy.optimize import root_scalar  # noqa: PLC0415

    least, estimate = 1e-9, min(successes / n, 1.0 - 1e-9)

    def excess(bar: float) -> float:
        return log_capital_above(successes, n, bar) - enough

    if successes == 0 or excess(least) <= 0.0:
        return 0.0
    return math.floor(float(root_scalar(excess, bracket=(least, estimate), xtol=1e-12).root) * _DIGITS) / _DIGITS
