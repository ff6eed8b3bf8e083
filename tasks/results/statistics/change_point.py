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
from the worlds that came new after the first night, and from nights that follow one another (von Neumann 1941, Annals
of Mathematical Statistics 12:367). A night counts for the first as much as its episodes weigh in the rates. Simulations
of whole histories show what is left of the guarantee: benchmarks/results/trend.py.
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
# Nights that are looked at in one go; as many numbers as a processor has at hand.
_AT_ONCE = 16
_Lasts = Int[np.ndarray, " lasts"]
_Begins = Int[np.ndarray, "lasts begins"]
_Evidence = Float[np.ndarray, "lasts begins"]


class NightCount(NamedTuple):
    """What is counted of a night.

    Attributes:
        successes: Episodes that passed.
        n: Episodes that were counted.
        scatter: Sum over the night's new worlds of (successes - n x rate)^2 / n; a world is new where the night before
            did not have it. A level's first night is compared with no night before, so that its own is not used.
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
    start, looked, last = 0, 1, 1
    while last < len(used):
        lasts = np.arange(last, min(last + _AT_ONCE, len(used)))
        begins, evidence = sums.evidence(start, looked, lasts)
        top = evidence.max(axis=1)
        total = top + np.log(np.exp(evidence - top[:, None]).sum(axis=1))
        alarms = np.flatnonzero(total >= math.log(limit))
        if not len(alarms):
            last = int(lasts[-1]) + 1
            continue
        row = int(alarms[0])
        change = sums.change(start, begins[row], int(lasts[row]), evidence[row])
        start, looked, last = change.began, change.seen + 1, change.seen + 1
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
        successes, n, scatter, freedom = np.array(nights, np.float64).reshape(-1, 4).T
        rate = successes / n
        # The step into a night: its squared difference from the night before, in units of one episode's variance.
        steps = np.zeros(len(nights))
        steps[1:] = np.diff(rate) ** 2 / (1.0 / n[1:] + 1.0 / n[:-1])
        # Many episodes a world make a night scatter more, and weigh more in the rates: they weigh as much here.
        columns = (successes, n, n * scatter, n * freedom, steps)
        return _Sums(*(np.concatenate([[0.0], np.cumsum(each)]) for each in columns))

    def evidence(self, start: int, looked: int, lasts: _Lasts) -> tuple[_Begins, _Evidence]:
        """Returns the nights that may be the first of a new level, and the logarithm of the evidence for each.

        Args:
            start: The first night of the level.
            looked: The first night that may be one; what is before it has no evidence, minus infinity.
            lasts: The nights after which somebody looks, one a row.
        """
        back = min(_MOST_NIGHTS_BACK, int(lasts[-1]) - looked + 1)
        asked = lasts[:, None] - np.arange(back)[::-1]
        begins = np.maximum(asked, looked)
        scale = 1.0 / self._dispersion(start, begins, lasts[:, None])
        ends = lasts[:, None] + 1
        whole_s, whole_n = (each[ends] - each[start] for each in (self.successes, self.n))
        late_s, late_n = (each[ends] - each[begins] for each in (self.successes, self.n))
        early = _log_marginals((whole_s - late_s) * scale, (whole_n - late_n) * scale)
        late, whole = _log_marginals(late_s * scale, late_n * scale), _log_marginals(whole_s * scale, whole_n * scale)
        return begins, np.where(asked < looked, -np.inf, early + late - whole)

    def _dispersion(self, start: int, begins: _Begins, lasts: _Begins) -> _Evidence:
        """Returns how much more nights differ than by the chance of single episodes; 1 at least."""
        ends = lasts + 1
        whole_s, whole_n = self.successes[ends] - self.successes[start], self.n[ends] - self.n[start]
        rate = (whole_s + _PRIOR) / (whole_n + 2.0 * _PRIOR)
        variance = rate * (1.0 - rate)
        # Without the first night: worlds that stay after it make no night differ from another.
        freedom = self.freedom[ends] - self.freedom[start + 1]
        scatter = (self.scatter[ends] - self.scatter[start + 1]) / variance
        within = np.where(freedom > 0.0, np.maximum(1.0, scatter / np.maximum(freedom, 1.0)), 1.0)
        # Without the step into the new level, which is what is tested.
        steps = self.steps[ends] - self.steps[start + 1] - np.diff(self.steps)[begins]
        between = (_PRIOR_NIGHTS * within + steps / variance) / (_PRIOR_NIGHTS + lasts - start - 1)
        return np.maximum(within, between)

    def change(
        self, start: int, begins: Int[np.ndarray, " begins"], last: int, evidence: Float[np.ndarray, " begins"]
    ) -> Change:
        """Returns the change that the evidence speaks for."""
        share = np.exp(evidence - evidence.max())
        share /= share.sum()
        order = np.argsort(-share, kind="stable")
        believed = begins[order[: int(np.searchsorted(np.cumsum(share[order]), _BELIEVED)) + 1]]
        began = int(begins[order[0]])
        return Change(
            seen=last,
            began=began,
            earliest=int(believed.min()),
            latest=int(believed.max()),
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
    passed, failed = _log_gamma(successes + _PRIOR), _log_gamma(n - successes + _PRIOR)
    return passed + failed - _log_gamma(n + 2.0 * _PRIOR) - math.log(math.pi)


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
    rising = np.log(rising * (x + 4.0) * (x + 5.0) * (x + 6.0) * (x + 7.0))
    return (y - 0.5) * np.log(y) - y + 0.5 * math.log(2.0 * math.pi) + series - rising
