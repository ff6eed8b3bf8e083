"""Guesses which name a misspelled one was meant to be."""

import difflib
from collections.abc import Iterable

ALIKE = 0.6
"""How much alike two names are where one is probably meant by the other, as difflib counts, 0-1."""


def nearest(text: str, known: Iterable[str], alike: float = ALIKE) -> str:
    """Returns the known name that a text is most like, whatever its capitals; empty if it is like none.

    Args:
        text: The name.
        known: The names that there are.
        alike: How much alike they must be, 0-1.
    """
    lowered = {one.lower(): one for one in known}
    close = difflib.get_close_matches(text.lower(), list(lowered), n=1, cutoff=alike)
    return lowered[close[0]] if close else ""


def meant(text: str, known: Iterable[str]) -> str:
    """Returns ``did you mean "..."? `` with the known name that a text is most like; empty if it is like none."""
    found = nearest(text, known)
    return f'did you mean "{found}"? ' if found else ""
