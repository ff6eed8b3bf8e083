"""Where in a row of nights a rate changed: a Shiryaev-Roberts test with unknown rates before and after.

For each night that may be the first of a new level, the evidence is a Bayes factor: two rates, one before that night
and one from it on, against one rate; each with Jeffreys' prior, so that beta functions say it. The evidence of all such
nights is summed up, and there is an alarm when the sum reaches a limit (Shiryaev 1963, Theory of Probability and Its
Applications 8:22; Roberts 1966, Technometrics 8:411; as e-detector, Shin, Ramdas and Rinaldo 2024, New England Journal
of Statistics in Data Science 2:229). While nothing changes, each Bayes factor is expected to stay 1, averaged over the
prior, so that the sum grows by one a night and the limit is the mean number of nights until a false alarm. A factor
does not ask why a night had as many episodes as it had: a batch that ended early counts like any other.

Nights differ by more than the chance of single episodes where worlds are drawn anew. Their counts are then divided by
a factor of dispersion (quasi-likelihood: Wedderburn 1974, Biometrika 61:439), which is the larger of two estimates:
from the worlds within the nights, and from nights that follow one another (von Neumann 1941, Annals of Mathematical
Statistics 12:367). Simulations of whole histories show what is left of the guarantee: benchmarks/results/trend.py.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

NIGHTS_A_YEAR = 365
# A change that began longer ago is not looked for: it would have been seen.
_MOST_NIGHTS_BACK = 128
_PRIOR_NIGHTS = 4.0
_PRIOR = 0.5
_BELIEVED = 0.9


class NightCount(NamedTuple):
    """What is counted of a night.

    Attributes:
        successes: Episodes that passed.
        n: Episodes that were counted.
        scatter: Sum over the night's new worlds of (successes - n x rate)^2 / n; a world is new where the night before
            did not have it.
        freedom: How many new worlds there are, less one; 0 for none.
    """

    successes: int
    n: int
    scatter: float = 0.0
    freedom: int = 0


@dataclass(frozen=True)
class Change:
    """A change that was seen; nights are positions in the row.

    Attributes:
        seen: The night of the alarm.
        began: The night at which the new level most likely began.
        earliest: The first night of those that may be the beginning.
        latest: The last of them.
        before: The rate from the change before, or the row's beginning, until then.
        after: The rate from then to the alarm.
    """

    seen: int
    began: int
    earliest: int
    latest: int
    before: float
    after: float

    @property
    def fell(self) -> bool:
        """Whether the rate fell."""
        return self.after < self.before


def find_changes(nights: Sequence[NightCount], limit: float) -> list[Change]:
    """Returns the changes of the rate, in the order in which they were seen.

    After an alarm the test begins again: the new level is what later nights are compared with.

    Args:
        nights: In their order; those without episodes say nothing.
        limit: How many nights without a change there are, in the mean, until a false alarm.
    """
    used = [at for at, night in enumerate(nights) if night.n > 0]
    sums = _Sums.of([nights[at] for at in used])
    found: list[Change] = []
    start, looked = 0, 1
    for last in range(len(used)):
        first = max(looked, start + 1, last - _MOST_NIGHTS_BACK + 1)
        if first > last:
            continue
        evidence = sums.evidence(start, np.arange(first, last + 1), last)
        top = float(evidence.max())
        if top + math.log(np.exp(evidence - top).sum()) < math.log(limit):
            continue
        change = sums.change(start, first, last, evidence)
        start, looked = change.began, last + 1
        found.append(_at_nights(change, used))
    return found


@dataclass(frozen=True)
class _Sums:
    """Sums over the first nights, so that a sum over any nights is a difference."""

    successes: Float[np.ndarray, " nights+1"]
    n: Float[np.ndarray, " nights+1"]
    scatter: Float[np.ndarray, " nights+1"]
    freedom: Float[np.ndarray, " nights+1"]
    steps: Float[np.ndarray, " nights+1"]

    @staticmethod
    def of(nights: Sequence[NightCount]) -> "_Sums":
        """Returns the sums of nights that all have episodes."""
        columns = np.array(nights, np.float64).reshape(-1, 4).T
        successes, n = columns[0], columns[1]
        rate = successes / n
        # The step into a night: its squared difference from the night before, in units of one episode's variance.
        steps = np.zeros(len(nights))
        steps[1:] = np.diff(rate) ** 2 / (1.0 / n[1:] + 1.0 / n[:-1])
        return _Sums(*(np.concatenate([[0.0], np.cumsum(each)]) for each in (*columns, steps)))

    def evidence(self, start: int, begins: Int[np.ndarray, " begins"], last: int) -> Float[np.ndarray, " begins"]:
        """Returns the logarithm of the evidence for each night that may be the first of the new level."""
        scale = 1.0 / self._dispersion(start, begins, last)
        whole_s, whole_n = (each[last + 1] - each[start] for each in (self.successes, self.n))
        late_s, late_n = (each[last + 1] - each[begins] for each in (self.successes, self.n))
        passed = np.stack([whole_s - late_s, late_s, np.full_like(late_s, whole_s)]) * scale
        n = np.stack([whole_n - late_n, late_n, np.full_like(late_n, whole_n)]) * scale
        early, late, whole = _log_marginals(passed, n)
        return early + late - whole

    def _dispersion(self, start: int, begins: Int[np.ndarray, " begins"], last: int) -> Float[np.ndarray, " begins"]:
        """Returns how much more nights differ than by the chance of single episodes; 1 at least."""
        whole_s, whole_n = self.successes[last + 1] - self.successes[start], self.n[last + 1] - self.n[start]
        rate = (whole_s + _PRIOR) / (whole_n + 2.0 * _PRIOR)
        variance = rate * (1.0 - rate)
        freedom = self.freedom[last + 1] - self.freedom[start]
        within = (self.scatter[last + 1] - self.scatter[start]) / variance / freedom if freedom else 1.0
        within = max(1.0, within)
        # Without the step into the new level, which is what is tested.
        steps = self.steps[last + 1] - self.steps[start + 1] - np.diff(self.steps)[begins]
        count = last - start - 1
        between = (_PRIOR_NIGHTS * within + steps / variance) / (_PRIOR_NIGHTS + count)
        return np.maximum(within, between)

    def change(self, start: int, first: int, last: int, evidence: Float[np.ndarray, " begins"]) -> Change:
        """Returns the change that the evidence speaks for."""
        share = np.exp(evidence - evidence.max())
        share /= share.sum()
        order = np.argsort(-share, kind="stable")
        believed = order[: int(np.searchsorted(np.cumsum(share[order]), _BELIEVED)) + 1]
        began = first + int(order[0])
        return Change(
            seen=last,
            began=began,
            earliest=first + int(believed.min()),
            latest=first + int(believed.max()),
            before=self._rate(start, began),
            after=self._rate(began, last + 1),
        )

    def _rate(self, first: int, end: int) -> float:
        return float((self.successes[end] - self.successes[first]) / (self.n[end] - self.n[first]))


def _at_nights(change: Change, used: Sequence[int]) -> Change:
    at = {name: used[getattr(change, name)] for name in ("seen", "began", "earliest", "latest")}
    return Change(**at, before=change.before, after=change.after)


def _log_marginals(successes: Float[np.ndarray, "..."], n: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Returns the logarithm of the chance of episodes in their order, whatever the rate, by Jeffreys' prior."""
    # All at once: of so few numbers each call costs more than what it computes.
    passed, failed, both = _log_gamma(np.stack([successes + _PRIOR, n - successes + _PRIOR, n + 2.0 * _PRIOR]))
    return passed + failed - both - math.log(math.pi)


def _log_gamma(x: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Returns the logarithm of the gamma function of positive numbers, to 1e-12.

    Stirling's series (NIST Digital Library of Mathematical Functions, 5.11.1) at x + 8. scipy has it, too, but takes
    half as long to import as a thousand nights to read.
    """
    y = x + 8.0
    inverse = 1.0 / y
    square = inverse * inverse
    series = inverse * (1 / 12 - square * (1 / 360 - square * (1 / 1260 - square / 1680)))
    rising = x * (x + 1.0) * (x + 2.0) * (x + 3.0)
    rising = np.log(rising) + np.log((x + 4.0) * (x + 5.0) * (x + 6.0) * (x + 7.0))
    return (y - 0.5) * np.log(y) - y + 0.5 * math.log(2.0 * math.pi) + series - rising
