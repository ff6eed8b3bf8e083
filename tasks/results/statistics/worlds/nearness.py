"""How far below the highest log likelihood the bounds of an interval over worlds lie."""

import numpy as np
from jaxtyping import Float


def nearness(seldom: Float[np.ndarray, " sets"], worlds: int, confidence: float) -> Float[np.ndarray, " sets"]:
    """Returns the greater of what few worlds and what few events ask for.

    Few worlds: ``t(K - 1)^2 / 2`` instead of ``z^2 / 2``, since the spread is known by K worlds alone. Few events: of
    f worlds that had one, as the limit of many worlds in which it is rare, f is of a Poisson distribution, whose exact
    bound is ``u = chi2(2 f + 2) / 2`` (Garwood 1936, Biometrika 28:437); there the log likelihood is ``u - f -
    f log(u / f)`` below its highest.

    Args:
        seldom: Of each data set, in how many worlds there was what the bound limits: a failure for a lower bound of
            the success rate, a success for an upper one.
        worlds: Two at least.
        confidence: Coverage, between 0 and 1.
    """
    from scipy.special import gammaincinv, stdtrit, xlogy  # noqa: PLC0415 - most commands judge nothing

    sure = (1.0 + confidence) / 2.0
    bound = gammaincinv(seldom + 1.0, sure)
    few_events = bound - seldom - xlogy(seldom, bound) + xlogy(seldom, seldom)
    return np.maximum(float(stdtrit(worlds - 1, sure)) ** 2 / 2.0, few_events)
