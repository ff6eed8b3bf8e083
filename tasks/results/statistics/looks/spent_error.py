"""How much of a test's error may be spent by each of the looks at a batch.

A test that looks K times has to share its error among the looks. A spending function says how much may be used up once
a share t of the episodes is in, whatever the looks are (Lan and DeMets 1983, Biometrika 70:659). The one here is that
of Hwang, Shih and DeCani 1990 (Statistics in Medicine 9:1439) with the parameter -2: it lies between O'Brien and
Fleming, who spend next to nothing at first, and equal parts. What it was compared with, and why it was taken, is in
``docs/decisions/0022-looks-with-an-end-in-sight.md``.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

_GAMMA = -2.0
# The walk's density lives within eight standard deviations; Simpson's rule on so many points errs by less than 1e-9.
_REACH, _POINTS = 8.0, 401
_HALVINGS = 60


def spent_error(looks: Sequence[int], alpha: float) -> tuple[float, ...]:
    """Returns how much error may be used up after each look, the last number being ``alpha``.

    Args:
        looks: Episodes at each look, rising; the last number is that of the whole batch.
        alpha: Of a one-sided test, between 0 and 1.

    Raises:
        ValueError: The looks do not rise from 1 on, or there are none.
    """
    if not looks or looks[0] < 1 or any(later <= look for look, later in itertools.pairwise(looks)):
        raise ValueError(f"looks at {tuple(looks)} episodes: at least one, rising from 1 on")
    whole = math.expm1(-_GAMMA)
    return tuple(alpha * math.expm1(-_GAMMA * look / looks[-1]) / whole for look in looks)


def nominal_levels(looks: Sequence[int], spent: Sequence[float]) -> tuple[float, ...]:
    """Returns the level of the ordinary one-sided test at each look, at which all looks together err as they may.

    For a statistic that is normal with independent increments, by numerical integration over the walk's density
    (Armitage, McPherson and Rowe 1969, JRSS A 132:235; Jennison and Turnbull 2000, Group Sequential Methods, chapter
    19). Five equal looks that spend alpha as O'Brien and Fleming give their critical values.

    Args:
        looks: Episodes at each look, rising.
        spent: How much error may be used up after each.
    """
    levels, used, before = list[float](), 0.0, 0.0
    points, mass = np.zeros(1), np.ones(1)
    for look, allowed in zip(looks, spent, strict=True):
        time = look / looks[-1]
        step, deviation = math.sqrt(time - before), math.sqrt(time)
        bar = _bar(points, mass, step, allowed - used, deviation)
        levels.append(0.5 * math.erfc(bar / deviation / math.sqrt(2.0)))
        points, mass = _survivors(points, mass, step, bar, deviation)
        used, before = allowed, time
    return tuple(levels)


def _bar(
    points: Float[np.ndarray, " points"], mass: Float[np.ndarray, " points"], step: float, allowed: float, top: float
) -> float:
    """Returns where the walk has to be so that it is there, or above, with that probability."""
    from scipy.special import ndtr  # noqa: PLC0415 - most commands judge nothing

    low, high = -_REACH * top, (_REACH + 2.0) * top
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        reached = float(mass @ ndtr((points - middle) / step))
        low, high = (middle, high) if reached > allowed else (low, middle)
    return high


def _survivors(
    points: Float[np.ndarray, " points"],
    mass: Float[np.ndarray, " points"],
    step: float,
    bar: float,
    deviation: float,
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Returns points below the bar after the next step, and the probability that each stands for."""
    onward = np.linspace(-_REACH * deviation, bar, _POINTS)
    away = (onward[:, None] - points[None, :]) / step
    density = np.exp(-0.5 * away * away) @ mass / (step * math.sqrt(2.0 * math.pi))
    weights = np.full(_POINTS, 2.0)
    weights[1::2], weights[0], weights[-1] = 4.0, 1.0, 1.0
    return onward, density * weights * (onward[1] - onward[0]) / 3.0
