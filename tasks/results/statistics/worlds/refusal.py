"""Why nothing is said of worlds like those that were drawn."""

from typing import Literal

_FEWEST = {"rate": 2, "quantile": 2, "difference": 2}


def why_refused(of: Literal["rate", "quantile", "difference"], worlds: int) -> str:
    """Returns why an interval over worlds says nothing, as a sentence; empty where it says something.

    Args:
        of: What the interval is of.
        worlds: How many worlds have episodes.
    """
    fewest = _FEWEST[of]
    if worlds >= fewest:
        return ""
    return f"{worlds} worlds say too little of worlds like them: draw {fewest} or more"
