"""Limits that a team may raise above RoboMaker's, read from the environment."""

import os

from specs.base import Fault
from specs.errors import DocumentError

MAX_WORLDS = "SIMYARD_MAX_WORLDS"
_ROBOMAKERS_MAX_WORLDS = 50


def max_worlds_of_job() -> int:
    """Returns how many worlds a generation job makes at most: 50, as RoboMaker's, or SIMYARD_MAX_WORLDS.

    Raises:
        DocumentError: SIMYARD_MAX_WORLDS is no number of worlds.
    """
    text = os.environ.get(MAX_WORLDS)
    if not text:
        return _ROBOMAKERS_MAX_WORLDS
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise DocumentError([Fault(path=MAX_WORLDS, value=repr(text), allowed="a number of worlds, at least 1")])
    return int(text)
