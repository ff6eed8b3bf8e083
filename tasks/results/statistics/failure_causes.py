"""What failures have in common: which variables carry them, and how probable a failure is where.

The particles of a search that failed, each with its weight, stand for all failures. So the share of them that lies in a
part of a variable's distribution says how probable a failure is there, without any model (Bayes' rule). What several
variables do together is asked of a surrogate: a kernel logistic regression (Zhu and Hastie 2005, Journal of
Computational and Graphical Statistics 14:185) of failures against plain draws that passed. It is fitted to some
populations of the search and asked about others, which it has not seen: how well it tells their failures is shown
beside all that it says. Of thinned draws it is a regression of failures against whatever else was simulated: they were
chosen by what varies alone, which changes nothing of how probable a failure is at a point.

How much each variable carries is its Shapley effect (Owen 2014, SIAM/ASA Journal on Uncertainty Quantification 2:245):
its share of the variance of the probability of failure, with what variables do together shared out among them. They add
up to 1. A set's part of the variance is the mean, over failures, of the probability where the set keeps its values and
all others are drawn anew. Intervals are those of the jackknife over populations, which are independent of each other.
"""

from collections.abc import Sequence
from itertools import permutations
from math import sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from specs.base import Spec
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.populations import Seen
from tasks.results.statistics.rare_failures import scatter_interval
from tasks.results.statistics.surrogate import Features, Points, logistic, logistic_weights, points_of, together

PARTS = 10
"""So many parts of the same probability has the distribution of a number."""
WORLD = "world"
"""Name of the factor that says in which world an episode is."""
_MOST_SHOWN = 10  # values of a choice, or worlds
_FEWEST_FAILURES = 40
_FEWEST_POPULATIONS = 6
_FOLDS = 3
_REDRAWN = 8  # times, for each failure, the variables that a set does not keep
_ALL_ORDERS = 4  # variables at most of which all orders are taken; of more so many pairs of an order and its reverse:
_ORDERS = 24
# Tried for the surrogate: the kernel's width in standard deviations, and the penalty of its weights, the largest first.
_WIDTHS = (1.0, 2.0)
_RIDGES = (1.0, 0.1, 0.01, 0.001)
_MOST_FAILURES = 4_000
_MOST_CHOSEN = 12_000  # failures and passes of thinned draws
_POINTS = 200  # of failures on the map


class Factor(NamedTuple):
    """What varies.

    Attributes:
        name: A variable's or parameter's, or ``world``.
        parts: For a person: of a number, each part of its distribution; else its values, each as likely.
        number: Whether it is one.
    """

    name: str
    parts: tuple[str, ...]
    number: bool


class CausePart(Spec):
    """A part of what a variable's values may be.

    Attributes:
        values: Which, for a person.
        probability: That an episode fails whose variable is in it.
        interval: Covers it with the search's confidence.
    """

    values: str
    probability: float
    interval: Interval


class Cause(Spec):
    """A variable, and how much it carries.

    Attributes:
        name: The variable's or parameter's, or ``world``.
        share: Its Shapley effect; the shares of all add up to 1.
        interval: Covers it with the search's confidence; cut off at 0 and 1.
        parts: The parts of a number's distribution in order, or the values whose failures are most probable first.
        more: How many values are left out.
    """

    name: str
    share: float
    interval: Interval
    parts: tuple[CausePart, ...]
    more: int = 0


class FailureMap(Spec):
    """How probable a failure is over two numbers, by the surrogate.

    Attributes:
        across: Name of the number from left to right.
        up: Of the other one, from below.
        probability: Of each part of ``up``, from the lowest, the probabilities over the parts of ``across``.
        failures: Some that the search has found: how much of the distribution of ``across`` and of ``up`` lies below.
    """

    across: str
    up: str
    probability: tuple[tuple[float, ...], ...]
    failures: tuple[tuple[float, float], ...]


class FailureCauses(Spec):
    """What failures have in common.

    Attributes:
        causes: The variable that carries most comes first; empty where nothing can be said.
        why: Why nothing can be said, as a sentence; else empty.
        told: How often the surrogate finds a failure more probable than an episode that passed, both held back.
        map: Over the two numbers that carry most; None where there are not two.
    """

    causes: tuple[Cause, ...] = ()
    why: str = ""
    told: float | None = None
    map: FailureMap | None = None

    @property
    def sentence(self) -> str:
        """Which variables carry the failures, and how well that was checked, for a person."""
        if not self.causes:
            return f"what causes failures is not known: {self.why}"
        shares = ", ".join(
            f"{each.name} {100 * each.share:.0f} % ({100 * each.interval.lower:.0f} to {100 * each.interval.upper:.0f})"
            for each in self.causes
        )
        return (
            f"failures are carried by {shares}; of a failure and a pass that were held back, the surrogate tells which "
            f"is which in {100 * (self.told or 0.0):.0f} of 100"
        )


def failure_causes(seen: Seen, factors: Sequence[Factor], probability: float, confidence: float) -> FailureCauses:
    """Returns what the failures of a search have in common.

    Args:
        seen: Its particles. Their smooth coordinates are numbers; of the drawn ones, the first are choices.
        factors: What the coordinates are: the numbers, then the choices. Further drawn ones are what is left to chance.
        probability: That an episode fails.
        confidence: Of the intervals, between 0 and 1.
    """
    if not factors:
        return FailureCauses(why="nothing varies but the seed")
    seen = _fewer(seen)
    populations = len(np.unique(seen.failed_of))
    if len(seen.weights) < _FEWEST_FAILURES or populations < _FEWEST_POPULATIONS:
        return FailureCauses(why=f"{len(seen.weights)} failures in {populations} populations are too few")
    if len(np.unique(_folds(seen)[seen.passed_of])) < _FOLDS:
        return FailureCauses(why="hardly an episode passed")
    counts = [len(each.parts) for each in factors if not each.number]
    failed, passed = points_of(seen.failed, counts), points_of(seen.passed, counts)
    surrogate = _HeldBack(seen, failed, passed, counts, probability)
    shares = _shares(surrogate, len(factors), np.unique(seen.failed_of), seen, confidence)
    if not shares:
        return FailureCauses(why="failures are where passes are: neither variables nor worlds decide, but seeds")
    causes = [
        _cause(factor, seen, _parts(failed, at, factor), share, confidence)
        for at, (factor, share) in enumerate(zip(factors, shares, strict=True))
    ]
    order = sorted(range(len(factors)), key=lambda at: -shares[at][0])
    numbers = [at for at in order if factors[at].number][:2]
    return FailureCauses(
        causes=tuple(causes[at] for at in order),
        told=surrogate.told,
        map=_map(surrogate, factors, failed, numbers) if len(numbers) == 2 else None,
    )


def _fewer(seen: Seen) -> Seen:
    """Returns the same with fewer particles, each of which stands for more, where there are very many."""
    every = 1 + len(seen.weights) // _MOST_FAILURES
    if seen.passed_weights is not None:
        every = 1 + (len(seen.weights) + len(seen.passed_weights)) // _MOST_CHOSEN
        kept = np.arange(0, len(seen.passed_weights), every)  # as many of a hundred as of failures
        passed_weights = seen.passed_weights[kept]
        seen = seen._replace(
            passed=seen.passed.take(kept), passed_of=seen.passed_of[kept], passed_weights=passed_weights
        )
    kept = np.arange(0, len(seen.weights), every)
    return seen._replace(
        failed=seen.failed.take(kept), weights=every * seen.weights[kept], failed_of=seen.failed_of[kept]
    )


def _parts(points: Points, at: int, factor: Factor) -> Int[np.ndarray, "points"]:
    """Returns in which part of a factor each point is."""
    from scipy.special import ndtr  # noqa: PLC0415 - it takes long to load

    numbers = points.numbers.shape[1]
    if not factor.number:
        return points.choices[:, at - numbers]
    return np.minimum((ndtr(points.numbers[:, at]) * PARTS).astype(np.int64), PARTS - 1)


def _cause(
    factor: Factor,
    seen: Seen,
    parts: Int[np.ndarray, "failed"],
    share: tuple[float, Interval],
    confidence: float,
) -> Cause:
    """Returns a factor with how probable failures are in each of its parts."""
    many = len(factor.parts)
    within = np.zeros((many, seen.populations))
    np.add.at(within, (parts, seen.failed_of), seen.weights * many)
    whole = np.bincount(seen.failed_of, seen.weights, seen.populations)
    # Where none failed: not more than if all failures were there.
    most = scatter_interval(whole, confidence, Interval(lower=0.0, upper=1.0)).upper
    none = Interval(lower=0.0, upper=min(many * most, 1.0))
    found = [
        CausePart(
            values=values, probability=float(each.mean()), interval=_capped(scatter_interval(each, confidence, none))
        )
        for values, each in zip(factor.parts, within, strict=True)
    ]
    if not factor.number:
        found.sort(key=lambda each: -each.probability)
    shown = found if factor.number else found[:_MOST_SHOWN]
    return Cause(name=factor.name, share=share[0], interval=share[1], parts=tuple(shown), more=many - len(shown))


def _capped(interval: Interval) -> Interval:
    return Interval(lower=min(interval.lower, 1.0), upper=min(interval.upper, 1.0))


class _Surrogate(NamedTuple):
    """How probable a failure is at a point: kernel logistic regression.

    Attributes:
        features: What it is linear in.
        weights: Of each.
        odds: Logarithm of how many failures there are for each pass, among all draws.
    """

    features: Features
    weights: Float64[np.ndarray, "features"]
    odds: float

    def probability(self, points: Points) -> Float64[np.ndarray, "points"]:
        """Returns how probable a failure is at each."""
        return logistic(self.features.evidence(points, self.weights) + self.odds)


class _HeldBack:
    """Surrogates, each asked about populations alone that it was not fitted to.

    Attributes:
        told: How often a failure is found more probable than a pass.
    """

    def __init__(self, seen: Seen, failed: Points, passed: Points, counts: Sequence[int], probability: float) -> None:
        self._seen, self._failed, self._passed, self._counts = seen, failed, passed, counts
        self._draws = np.random.Generator(np.random.Philox(0))
        folds = _folds(seen)
        self._failed_fold, self._passed_fold = folds[seen.failed_of], folds[seen.passed_of]
        # Failures of populations were chosen because they failed: the odds put that right.
        odds = 0.0 if seen.passed_weights is not None else float(np.log(probability / (1.0 - probability)))
        fits = [each for width in _WIDTHS for each in self._fitted(odds, width)]
        _, self.told, self._surrogates = max(fits, key=lambda each: each[0])

    def _fitted(self, odds: float, width: float) -> list[tuple[float, float, list[_Surrogate]]]:
        """Returns surrogates of each penalty: how likely they find what was held back, how often they tell it, they.

        What they are linear in is made once for all, and each begins with the weights of the one before.
        """
        likely, told = np.zeros(len(_RIDGES)), np.zeros(len(_RIDGES))
        surrogates: list[list[_Surrogate]] = [[] for _ in _RIDGES]
        for fold in range(_FOLDS):
            mine, other = self._failed_fold == fold, self._passed_fold == fold
            failed, passed = self._failed.take(~mine), self._passed.take(~other)
            kinds = np.repeat([1.0, 0.0], [len(failed.numbers), len(passed.numbers)])
            counted = np.concatenate(self._counted(~mine, ~other))
            of_mine, of_other = self._counted(mine, other)
            held = self._seen.weights[mine] / self._seen.weights[mine].sum()
            features = Features(failed, passed, width)
            of_known = features.of(together(failed, passed))
            of_failed, of_passed = features.of(self._failed.take(mine)), features.of(self._passed.take(other))
            weights = np.zeros(of_known.shape[1])
            for at, ridge in enumerate(_RIDGES):
                weights = logistic_weights(of_known, kinds, counted, features.penalty(ridge), weights)
                failing, passing = of_failed @ weights, of_passed @ weights
                lost = of_mine @ np.logaddexp(0.0, -failing) + of_other @ np.logaddexp(0.0, passing)
                likely[at] -= float(lost) / (of_mine.sum() + of_other.sum())
                told[at] += _told(failing, held, passing, self._stand_for(other)) / _FOLDS
                surrogates[at].append(_Surrogate(features, weights, odds))
        return list(zip(likely.tolist(), told.tolist(), surrogates, strict=True))

    def _counted(
        self, failed: Bool[np.ndarray, "failed"], passed: Bool[np.ndarray, "passed"]
    ) -> tuple[Float64[np.ndarray, "some"], Float64[np.ndarray, "others"]]:
        """Returns how often some failures and some passes count in a fit.

        Both kinds of populations count alike, so that a rare one is not drowned; thinned draws count once each.
        """
        weights, passes = self._seen.weights[failed], int(passed.sum())
        if self._seen.passed_weights is not None:
            return np.ones(len(weights)), np.ones(passes)
        alike = min(len(weights), passes)
        return weights * (alike / weights.sum()), np.full(passes, alike / passes)

    def _stand_for(self, passed: Bool[np.ndarray, "passed"]) -> Float64[np.ndarray, "some"]:
        """Returns for which share of all passes some of them stand."""
        weights = np.ones(len(passed)) if self._seen.passed_weights is None else self._seen.passed_weights
        return weights[passed] / weights[passed].sum()

    def kept_sums(self, kept: frozenset[int]) -> Float64[np.ndarray, "populations"]:
        """Returns, of each population, the sum over its failures of how probable one is that keeps some factors."""
        sums = np.zeros(self._seen.populations)
        for fold, surrogate in enumerate(self._surrogates):
            mine = np.flatnonzero(self._failed_fold == fold)
            own, of, weights = self._failed.take(mine), self._seen.failed_of[mine], self._seen.weights[mine]
            for _ in range(_REDRAWN):
                again = surrogate.probability(own.keeping(kept, self.drawn(len(mine))))
                sums += np.bincount(of, weights * again / _REDRAWN, self._seen.populations)
        return sums

    def mean(self, points: Points) -> Float64[np.ndarray, "points"]:
        """Returns how probable a failure is at each point, by all surrogates together."""
        return np.mean([each.probability(points) for each in self._surrogates], axis=0)

    def drawn(self, count: int) -> Points:
        """Returns plain draws."""
        numbers = self._draws.standard_normal((count, self._failed.numbers.shape[1]))
        return Points(numbers, self._draws.integers(0, np.array(self._counts, np.int64), (count, len(self._counts))))


def _folds(seen: Seen) -> Int[np.ndarray, "populations"]:
    """Returns in which fold each population is; each fold has as many of those with failures as any other."""
    folds, failing = np.arange(seen.populations) % _FOLDS, np.unique(seen.failed_of)
    folds[failing] = np.arange(len(failing)) % _FOLDS
    return folds


def _told(
    failed: Float64[np.ndarray, "failed"],
    weights: Float64[np.ndarray, "failed"],
    passed: Float64[np.ndarray, "passed"],
    stand_for: Float64[np.ndarray, "passed"],
) -> float:
    """Returns how often a failure has more evidence than a pass; a tie counts half."""
    order = np.argsort(passed, kind="stable")
    ordered, up_to = passed[order], np.concatenate([[0.0], np.cumsum(stand_for[order])])
    below = up_to[np.searchsorted(ordered, failed, "left")] + up_to[np.searchsorted(ordered, failed, "right")]
    return float(weights @ below) / 2.0


def _shares(
    surrogate: _HeldBack, count: int, populations: Int[np.ndarray, "failing"], seen: Seen, confidence: float
) -> list[tuple[float, Interval]]:
    """Returns each factor's Shapley effect and its interval; none where all factors together carry nothing.

    Args:
        surrogate: Says what sets of factors carry.
        count: How many factors there are.
        populations: Those with failures.
        seen: Has their weights.
        confidence: Of the intervals.
    """
    from scipy.special import stdtrit  # noqa: PLC0415 - it takes long to load

    orders = _orders(count)
    sets = {frozenset(order[:length]): None for order in orders for length in range(count + 1)}
    sums = {kept: surrogate.kept_sums(kept)[populations] for kept in sets}
    weights = np.bincount(seen.failed_of, seen.weights, seen.populations)[populations]
    # Once with all populations, and once without each.
    without = ~np.eye(len(populations), dtype=bool)
    rows = np.concatenate([np.ones((1, len(populations)), bool), without])
    carried = {kept: (rows @ each) / (rows @ weights) for kept, each in sums.items()}
    effects = np.zeros((count, len(rows)))
    for order in orders:
        for length, factor in enumerate(order):
            gained = carried[frozenset(order[: length + 1])] - carried[frozenset(order[:length])]
            effects[factor] += gained / len(orders)
    reach = float(stdtrit(len(populations) - 1, (1.0 + confidence) / 2.0))
    whole = effects.sum(0)
    if whole[0] <= reach * _jackknife(whole[1:]) or whole.min() <= 0.0:
        return []
    shares = effects / whole
    return [_share(float(each[0]), reach * _jackknife(each[1:])) for each in shares]


def _share(share: float, reach: float) -> tuple[float, Interval]:
    """Returns a share and its interval; what is drawn anew at random may take either a little beyond 0 or 1."""
    low, middle, high = (round(min(max(each, 0.0), 1.0), 4) for each in (share - reach, share, share + reach))
    return middle, Interval(lower=low, upper=high)


def _jackknife(without: Float64[np.ndarray, "populations"]) -> float:
    """Returns the standard deviation of a figure by its values without each population (Efron and Stein 1981)."""
    return sqrt((len(without) - 1) * float(without.var()))


def _orders(count: int) -> list[tuple[int, ...]]:
    """Returns the orders in which factors are added: all, or of many some, each with its reverse."""
    if count <= _ALL_ORDERS:
        return list(permutations(range(count)))
    draws = np.random.Generator(np.random.Philox(2))
    some = [tuple(draws.permutation(count).tolist()) for _ in range(_ORDERS)]
    return [*some, *(each[::-1] for each in some)]


def _map(surrogate: _HeldBack, factors: Sequence[Factor], failed: Points, numbers: Sequence[int]) -> FailureMap:
    """Returns how probable failures are over two numbers, in the middle of each of their parts."""
    from scipy.special import ndtr, ndtri  # noqa: PLC0415 - it takes long to load

    across, up = numbers
    middles = ndtri((np.arange(PARTS) + 0.5) / PARTS)
    draws = surrogate.drawn(_REDRAWN * PARTS)
    rows: list[tuple[float, ...]] = []
    for upward in middles:
        row: list[float] = []
        for place in middles:
            at = draws.numbers.copy()
            at[:, across], at[:, up] = place, upward
            row.append(float(f"{surrogate.mean(Points(at, draws.choices)).mean():.3g}"))
        rows.append(tuple(row))
    some = failed.numbers[:: 1 + len(failed.numbers) // _POINTS][:, [across, up]]
    points = tuple((round(float(x), 3), round(float(y), 3)) for x, y in ndtr(some))
    return FailureMap(across=factors[across].name, up=factors[up].name, probability=tuple(rows), failures=points)
