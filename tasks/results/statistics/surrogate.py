"""A surrogate of an episode: how probable a failure is at a point of what a search varies.

It is a kernel logistic regression (Zhu and Hastie 2005, Journal of Computational and Graphical Statistics 14:185) on a
Nystrom approximation of the kernel, and on the numbers themselves.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from tasks.results.statistics.particles import Particles

_CENTRES = 120  # of the kernel
# Of what is linear in a variable: were it as large as the kernel's, weak variables would seem weaker than they are.
_FREE = 1e-3


class Points(NamedTuple):
    """Points of the space: standard normal numbers, and which value each choice has."""

    numbers: Float64[np.ndarray, "points numbers"]
    choices: Int[np.ndarray, "points choices"]

    def take(self, which: Int[np.ndarray, "some"] | Bool[np.ndarray, "points"]) -> "Points":
        """Returns some of them."""
        return Points(self.numbers[which], self.choices[which])

    def keeping(self, kept: frozenset[int], other: "Points") -> "Points":
        """Returns these with the other's values, but for the factors that are kept."""
        count = self.numbers.shape[1]
        numbers = np.isin(np.arange(count), [*kept])
        choices = np.isin(np.arange(count, count + self.choices.shape[1]), [*kept])
        return Points(
            np.where(numbers, self.numbers, other.numbers),
            np.where(choices, self.choices, other.choices),
        )


def points_of(particles: Particles, counts: Sequence[int]) -> Points:
    """Returns the points of particles whose first drawn coordinates are choices, each of so many values."""
    drawn = particles.drawn[:, : len(counts)]
    return Points(particles.smooth, (drawn * np.array(counts, np.float64)).astype(np.int64))


class Features:
    """What the evidence at a point is linear in: a Nystrom kernel to some of the points, the numbers, and 1."""

    def __init__(self, failed: Points, passed: Points, width: float) -> None:
        """Takes the centres of the kernel, half of them from failures.

        Args:
            failed: Failures.
            passed: Passes.
            width: Of the kernel, in standard deviations.
        """
        draws = np.random.Generator(np.random.Philox(1))
        self._width = width
        self._centres = together(_some(failed, _CENTRES // 2, draws), _some(passed, _CENTRES // 2, draws))
        values, vectors = np.linalg.eigh(self._kernel(self._centres))
        kept = values > 1e-6 * values[-1]
        self._to_features = vectors[:, kept] / np.sqrt(values[kept])

    def _kernel(self, points: Points) -> Float64[np.ndarray, "points centres"]:
        """Returns how alike points are to the centres: by their numbers, halved for each choice that differs."""
        own, centres = points.numbers, self._centres.numbers
        apart = (own**2).sum(1)[:, None] + (centres**2).sum(1) - 2.0 * own @ centres.T
        alike = np.exp(-apart / (2.0 * self._width**2 * max(own.shape[1], 1)))
        for mine, its in zip(points.choices.T, self._centres.choices.T, strict=True):
            alike *= np.where(mine[:, None] == its, 1.0, 0.5)
        return alike

    def of(self, points: Points) -> Float64[np.ndarray, "points features"]:
        """Returns the features of points."""
        kernel = self._kernel(points) @ self._to_features
        return np.concatenate([kernel, points.numbers / self._width, np.ones((len(kernel), 1))], axis=1)

    def penalty(self, ridge: float) -> Float64[np.ndarray, "features"]:
        """Returns the penalty of each weight."""
        kernel = self._to_features.shape[1]
        penalty = np.full(kernel + self._centres.numbers.shape[1] + 1, ridge)
        penalty[kernel:] = _FREE
        return penalty

    def evidence(
        self, points: Points, weights: Float64[np.ndarray, "features *kinds"]
    ) -> Float64[np.ndarray, "points *kinds"]:
        """Returns the features of points times their weights, without the features, of which there are many."""
        kernel = self._to_features.shape[1]
        of_kernel, of_numbers = self._to_features @ weights[:kernel], weights[kernel:-1] / self._width
        return self._kernel(points) @ of_kernel + points.numbers @ of_numbers + weights[-1]


def logistic(odds: Float64[np.ndarray, "*any"]) -> Float64[np.ndarray, "*any"]:
    """Returns the probability of which these are the logarithms of the odds."""
    return 0.5 * (1.0 + np.tanh(0.5 * odds))


def logistic_weights(
    features: Float64[np.ndarray, "points features"],
    kinds: Float64[np.ndarray, "points"],
    counted: Float64[np.ndarray, "points"],
    penalty: Float64[np.ndarray, "features"],
    weights: Float64[np.ndarray, "features"],
) -> Float64[np.ndarray, "features"]:
    """Returns the weights of a penalised logistic regression, by Newton's steps from some that are near."""
    for _ in range(30):
        likely = logistic(features @ weights)
        slope = features.T @ (counted * (kinds - likely)) - penalty * weights
        # A matrix times its own transpose takes half of what another product takes.
        root = features * np.sqrt(counted * np.maximum(likely * (1.0 - likely), 1e-9))[:, None]
        step = np.linalg.solve(root.T @ root + np.diag(penalty), slope)
        weights = weights + step / max(1.0, np.abs(step).max() / 5.0)  # a long one overshoots
        if np.abs(step).max() < 1e-4:
            break
    return weights


def together(*parts: Points) -> Points:
    """Returns the points of all parts, one part after the other."""
    return Points(np.concatenate([each.numbers for each in parts]), np.concatenate([each.choices for each in parts]))


def _some(points: Points, count: int, draws: np.random.Generator) -> Points:
    return points.take(draws.permutation(len(points.numbers))[:count])
