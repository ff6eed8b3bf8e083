"""Guesses which name a misspelled one was meant to be."""

import difflib
from collections.abc import Iterable

_ALIKE = 0.6


def meant(text: str, known: Iterable[str]) -> str:
    """Returns ``did you mean "..."? `` with the known name that a text is most like; empty if it is like none."""
    lowered = {one.lower(): one for one in known}
    close = difflib.get_close_matches(text.lower(), list(lowered), n=1, cutoff=_ALIKE)
    return f'did you mean "{lowered[close[0]]}"? ' if close else ""
