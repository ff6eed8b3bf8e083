"""Settings of a machine, read from the environment: limits above RoboMaker's, times to wait, and who simulates.

This process simulates, or the workers of a Dask or Ray cluster. No result depends on that, so no document and no
identity of a run names it.
"""

import os
import re
from pathlib import Path
from typing import Literal, NamedTuple

from specs.base import Spec
from specs.errors import DocumentError

ACCESS_FILE = "SIMYARD_ACCESS_FILE"
OWNER_KEY = "SIMYARD_OWNER_KEY"
REGION = "SIMYARD_REGION"
REGISTRIES = "SIMYARD_REGISTRIES"
"""Names registries of container images, with their ports, that calls over HTTP may have asked."""
TRUST_APPLICATIONS = "SIMYARD_TRUST_APPLICATIONS"
"""Set by --trust-applications: applications may run where nothing shuts them in."""
WORKS_FOR_OTHERS = "SIMYARD_WORKS_FOR_OTHERS"
"""Set in processes that work off a queue: what they run may be anybody's."""
ROBOMAKERS_MAX_WORLDS = 50
_REGION = re.compile(r"[a-z]{2}(-[a-z]+)+-[0-9]{1,2}")


class CountSetting(NamedTuple):
    """A whole number above 0 that the environment may set; it is read when it is asked for.

    Attributes:
        variable: Its name.
        default: What counts where the environment says nothing.
        what: What is counted, for the refusal of anything else.
    """

    variable: str
    default: int
    what: str

    def value(self) -> int:
        """Returns the number.

        Raises:
            DocumentError: The variable says something else.
        """
        text = os.environ.get(self.variable)
        if not text:
            return self.default
        if not (text.isascii() and text.isdigit() and int(text) > 0):
            raise DocumentError.of(self.variable, repr(text), f"a number of {self.what}, at least 1")
        return int(text)


MAX_WORLDS = CountSetting("SIMYARD_MAX_WORLDS", ROBOMAKERS_MAX_WORLDS, "worlds")
"""How many worlds a generation job makes at most."""
MIN_JOB_DURATION = CountSetting("SIMYARD_MIN_JOB_DURATION", 1, "seconds")
"""How many simulated seconds a job must be given.

Only RoboMaker's console had a minimum, of 300 (docs/reference/robomaker.md, section 3); an episode of a minute is a
good test.
"""
SERVER_WAIT = CountSetting("SIMYARD_SERVER_WAIT", 90, "seconds")
"""How long a run waits for a Prefect server that went away; one that is started again answers after half a minute."""
RECOUNT = CountSetting("SIMYARD_RECOUNT", 8, "episodes")
"""How many episodes are simulated again before anything is shipped."""
IMPORT_LIMIT = CountSetting("SIMYARD_IMPORT_LIMIT_S", 120, "seconds")
"""How long the import of an application may take."""
STEP_LIMIT = CountSetting("SIMYARD_STEP_LIMIT_S", 300, "seconds")
"""How long any other call of an application may take, such as a slice of control steps of all lanes of a chunk."""
ACTIONS_DAYS = CountSetting("SIMYARD_ACTIONS_DAYS", 90, "days")
"""For how many days a gateway keeps who did what."""


def access_file() -> Path:
    """Returns where clients' keys are: SIMYARD_ACCESS_FILE, else ``simyard/access-keys`` in the folder for settings."""
    chosen = os.environ.get(ACCESS_FILE)
    if chosen:
        return Path(chosen)
    settings = os.environ.get("XDG_CONFIG_HOME") or Path(os.environ.get("HOME") or Path.home()) / ".config"
    return Path(settings) / "simyard" / "access-keys"


def region() -> str:
    """Returns the region in the ARNs of RoboMaker's form: us-west-2, or SIMYARD_REGION.

    Raises:
        DocumentError: SIMYARD_REGION is no name of a region.
    """
    text = os.environ.get(REGION) or "us-west-2"
    if not _REGION.fullmatch(text):
        raise DocumentError.of(REGION, repr(text), "a region's name, such as us-west-2")
    return text


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
