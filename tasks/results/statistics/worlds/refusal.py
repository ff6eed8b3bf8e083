"""Why nothing is said of worlds like those that were drawn."""

import math
from typing import Literal

_FEWEST = 2
_WORLDS_IN_THE_TAIL = 2.0
_EXACT = 1e-9


def why_refused(of: Literal["rate", "quantile", "difference"], worlds: int, tail: float = 1.0) -> str:
    """Returns why an interval over worlds says nothing, as a sentence; empty where it says something.

    Args:
        of: What the interval is of.
        worlds: How many worlds have episodes.
        tail: Of a quantile: the share of values beyond it on the side of the bound, 0-1. That is the quantile for its
            lower bound, and 1 less the quantile for its upper one.
    """
    if worlds < _FEWEST:
        return f"{worlds} {'world says' if worlds == 1 else 'worlds say'} nothing of other worlds: draw 2 or more"
    fewest = math.ceil(_WORLDS_IN_THE_TAIL / tail - _EXACT)
    if of == "quantile" and worlds < fewest:
        return f"{worlds} worlds show too little of where {100.0 * tail:g} % of the values end: draw {fewest} or more"
    return ""
