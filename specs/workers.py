"""Who simulates: this process, or the workers of a Dask or Ray cluster. A setting of the machine, never of a document.

No result depends on it, so no document and no identity of a run names it.
"""

import os
import re
from typing import Literal

from specs.base import Fault, Spec
from specs.errors import DocumentError

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
    raise DocumentError([Fault(path=WORKERS, value=repr(text), allowed=_ALLOWED)])
