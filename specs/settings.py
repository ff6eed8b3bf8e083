"""Settings of a machine, read from the environment: limits above RoboMaker's, times to wait, and who simulates.

This process simulates, or the workers of a Dask or Ray cluster. No result depends on that, so no document and no
identity of a run names it.
"""

import os
import re
from typing import Literal

from specs.base import Spec
from specs.errors import DocumentError

MAX_WORLDS = "SIMYARD_MAX_WORLDS"
MIN_JOB_DURATION = "SIMYARD_MIN_JOB_DURATION"
SERVER_WAIT = "SIMYARD_SERVER_WAIT"
RECOUNT = "SIMYARD_RECOUNT"
OWNER_KEY = "SIMYARD_OWNER_KEY"
IMPORT_LIMIT = "SIMYARD_IMPORT_LIMIT_S"
STEP_LIMIT = "SIMYARD_STEP_LIMIT_S"
ACTIONS_DAYS = "SIMYARD_ACTIONS_DAYS"
REGION = "SIMYARD_REGION"
ROBOMAKERS_MAX_WORLDS = 50
_REGION = re.compile(r"[a-z]{2}(-[a-z]+)+-[0-9]{1,2}")


def max_worlds_of_job() -> int:
    """Returns how many worlds a generation job makes at most: 50, as RoboMaker's, or SIMYARD_MAX_WORLDS.

    Raises:
        DocumentError: SIMYARD_MAX_WORLDS is no number of worlds.
    """
    return count_setting(MAX_WORLDS, ROBOMAKERS_MAX_WORLDS, "a number of worlds, at least 1")


def min_job_duration_s() -> int:
    """Returns how many simulated seconds a job must be given: 1, or SIMYARD_MIN_JOB_DURATION.

    Only RoboMaker's console had a minimum, of 300 (docs/reference/robomaker.md, section 3); an episode of a minute is a
    good test.

    Raises:
        DocumentError: SIMYARD_MIN_JOB_DURATION is no number of seconds.
    """
    return count_setting(MIN_JOB_DURATION, 1, "a number of seconds, at least 1")


def server_wait_s() -> int:
    """Returns how many seconds a run waits for a Prefect server that went away: 90, or SIMYARD_SERVER_WAIT.

    One that is started again answers after half a minute.

    Raises:
        DocumentError: SIMYARD_SERVER_WAIT is no number of seconds.
    """
    return count_setting(SERVER_WAIT, 90, "a number of seconds, at least 1")


def recount_episodes() -> int:
    """Returns how many episodes are simulated again before anything is shipped: 8, or SIMYARD_RECOUNT.

    Raises:
        DocumentError: SIMYARD_RECOUNT is no number of episodes.
    """
    return count_setting(RECOUNT, 8, "a number of episodes, at least 1")


def import_limit_s() -> int:
    """Returns how many seconds the import of an application may take: 120, or SIMYARD_IMPORT_LIMIT_S.

    Raises:
        DocumentError: SIMYARD_IMPORT_LIMIT_S is no number of seconds.
    """
    return count_setting(IMPORT_LIMIT, 120, "a number of seconds, at least 1")


def step_limit_s() -> int:
    """Returns how many seconds any other call of an application may take: 300, or SIMYARD_STEP_LIMIT_S.

    A slice of control steps of all lanes of a chunk is such a call, too.

    Raises:
        DocumentError: SIMYARD_STEP_LIMIT_S is no number of seconds.
    """
    return count_setting(STEP_LIMIT, 300, "a number of seconds, at least 1")


def actions_days() -> int:
    """Returns for how many days a gateway keeps who did what: 90, or SIMYARD_ACTIONS_DAYS.

    Raises:
        DocumentError: SIMYARD_ACTIONS_DAYS is no number of days.
    """
    return count_setting(ACTIONS_DAYS, 90, "a number of days, at least 1")


def region() -> str:
    """Returns the region in the ARNs of RoboMaker's form: us-west-2, or SIMYARD_REGION.

    Raises:
        DocumentError: SIMYARD_REGION is no name of a region.
    """
    text = os.environ.get(REGION) or "us-west-2"
    if not _REGION.fullmatch(text):
        raise DocumentError.of(REGION, repr(text), "a region's name, such as us-west-2")
    return text


def count_setting(name: str, default: int, allowed: str) -> int:
    """Returns a whole number above 0 that the environment sets, or its default.

    Raises:
        DocumentError: The variable says something else.
    """
    text = os.environ.get(name)
    if not text:
        return default
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise DocumentError.of(name, repr(text), allowed)
    return int(text)


WORKERS = "SIMYARD_WORKERS"
_ALLOWED = (
    "dask or ray, for a worker on each core; dask:2 or ray:2, for that many on this machine; or the address of a "
    "cluster: tcp://host:8786, tls://host:8786 (Dask), ray://host:10001"
)
_LOCAL = re.compile(r"(dask|ray)(?::([1-9][0-9]{0,3}))?")
_ADDRESS = re.compile(r"(tcp|tls|ray)://[A-Za-z0-9.\-\[\]:]+:[0-9]{1,5}")


class Workers(Spec):
    """Where chunks are simulated.

    Attributes:
        kind: Dask's or Ray's task runner.
        address: The cluster's; empty for workers on this machine, for the length of a batch.
        count: How many of those; None for one on each core.
    """

    kind: Literal["dask", "ray"]
    address: str = ""
    count: int | None = None


def chosen_workers() -> Workers | None:
    """Returns what SIMYARD_WORKERS asks for; None where this process does the work.

    Raises:
        DocumentError: It asks for nothing that there is.
    """
    text = os.environ.get(WORKERS, "").strip()
    if not text:
        return None
    local = _LOCAL.fullmatch(text)
    if local:
        count = int(local[2]) if local[2] else None
        return Workers(kind="dask" if local[1] == "dask" else "ray", count=count)
    if _ADDRESS.fullmatch(text):
        return Workers(kind="ray" if text.startswith("ray://") else "dask", address=text)
    raise DocumentError.of(WORKERS, repr(text), _ALLOWED)
