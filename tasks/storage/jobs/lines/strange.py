"""Records that a stranger wrote: a list leaves them out and names them in the log, and shows everybody else's jobs."""

import logging
from collections.abc import Generator
from contextlib import contextmanager
from functools import lru_cache

from specs.errors import DocumentError, ObjectStrange
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store

_LOG = logging.getLogger(__name__)
_STRANGE = (ObjectStrange, DocumentError, ValueError, TypeError, LookupError, AttributeError)


@contextmanager
def left_out_if_strange(store: Store, kind: JobKind, job: str) -> Generator[None]:
    """Ends the block without an error where a job's record is not what Simyard writes; a store that fails is an error.

    Args:
        store: Where the job is.
        kind: The job's.
        job: Its id.
    """
    try:
        yield
    except _STRANGE as exc:
        _warn_once(f"{store.url}: {kind} {job}", f"{type(exc).__name__}: {str(exc)[:300]}")


@lru_cache(maxsize=4096)
def _warn_once(job: str, why: str) -> None:
    _LOG.warning("%s is left out of lists, its record cannot be read: %s", job, why)
