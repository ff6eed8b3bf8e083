"""Numbers that a team may choose, read from the environment: limits above RoboMaker's, and how long to wait."""

import os

from specs.base import Fault
from specs.errors import DocumentError

MAX_WORLDS = "SIMYARD_MAX_WORLDS"
MIN_JOB_DURATION = "SIMYARD_MIN_JOB_DURATION"
SERVER_WAIT = "SIMYARD_SERVER_WAIT"
_ROBOMAKERS_MAX_WORLDS = 50


def max_worlds_of_job() -> int:
    """Returns how many worlds a generation job makes at most: 50, as RoboMaker's, or SIMYARD_MAX_WORLDS.

    Raises:
        DocumentError: SIMYARD_MAX_WORLDS is no number of worlds.
    """
    return _number(MAX_WORLDS, _ROBOMAKERS_MAX_WORLDS, "a number of worlds, at least 1")


def min_job_duration_s() -> int:
    """Returns how many simulated seconds a job must be given: 1, or SIMYARD_MIN_JOB_DURATION.

    Only RoboMaker's console had a minimum, of 300 (semantics 3); an episode of a minute is a good test.

    Raises:
        DocumentError: SIMYARD_MIN_JOB_DURATION is no number of seconds.
    """
    return _number(MIN_JOB_DURATION, 1, "a number of seconds, at least 1")


def server_wait_s() -> int:
    """Returns how many seconds a run waits for a Prefect server that went away: 90, or SIMYARD_SERVER_WAIT.

    One that is started again answers after half a minute.

    Raises:
        DocumentError: SIMYARD_SERVER_WAIT is no number of seconds.
    """
    return _number(SERVER_WAIT, 90, "a number of seconds, at least 1")


def _number(name: str, default: int, allowed: str) -> int:
    text = os.environ.get(name)
    if not text:
        return default
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise DocumentError([Fault(path=name, value=repr(text), allowed=allowed)])
    return int(text)
