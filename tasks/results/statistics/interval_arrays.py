"""Intervals of many shares at once, for pages that draw hundreds of them."""

from statistics import NormalDist

import numpy as np
from jaxtyping import Float


def wilson_bounds(
    successes: Float[np.ndarray, "..."], n: Float[np.ndarray, "..."], confidence: float
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Returns the lower and upper bounds of many shares at once, as `wilson` has them; it needs no scipy.

    Args:
        successes: Each 0 to ``n``.
        n: How many were counted, 1 at least.
        confidence: Coverage, between 0 and 1.
    """
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    middle = (successes + z * z / 2.0) / (n + z * z)
    half = z / (n + z * z) * np.sqrt(successes * (n - successes) / n + z * z / 4.0)
    return np.maximum(middle - half, 0.0), np.minimum(middle + half, 1.0)
