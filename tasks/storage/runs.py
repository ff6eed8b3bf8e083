"""A run of a flow: a document's identity and a number (docs/decisions/0003).

The same document run again after a crash continues the run that did not end; run again after an end, it begins the
next.
"""

from collections.abc import Generator
from contextlib import contextmanager

from pydantic import JsonValue

from specs.errors import ResourceNotFound
from tasks.storage.claim import claimed
from tasks.storage.keys import claim_key
from tasks.storage.records import JobRecord, is_terminal, job_id, read, request_digest, submit
from tasks.storage.store import Store


@contextmanager
def begun(store: Store, identity: dict[str, JsonValue]) -> Generator[JobRecord, None, None]:
    """Yields the run of a document, which no other live process works on inside the ``with`` block.

    Waits while another process works on it; the yielded record is terminal when that one ended it, and then there is
    nothing left to do but to tell its result.

    Args:
        store: Where runs are recorded.
        identity: All that decides the outcome: the flow's name, the document, digests of what it refers to.
    """
    digest = request_digest(identity)[:32]
    record = submit(store, "pipeline-run", identity, _open_run(store, digest))
    with claimed(store, claim_key("pipeline-run", record.id)):
        yield read(store, "pipeline-run", record.id)


def stage_token(run: JobRecord, stage: str) -> str:
    """Returns the client request token of one of a run's stages."""
    return f"{run.id}-{stage}"


def _open_run(store: Store, digest: str) -> str:
    """Returns the token of the newest run if it is still open, else of the one after it."""
    newest = _newest(store, digest)
    if newest and not is_terminal(read(store, "pipeline-run", _id(digest, newest))):
        return _token(digest, newest)
    return _token(digest, newest + 1)


def _newest(store: Store, digest: str) -> int:
    """Returns the number of the newest run, 0 for none.

    Runs are numbered without gaps, so doubling and halving finds the last of a thousand nights in twenty requests, and
    no listing has to be believed.
    """
    known, unknown = 0, 1
    while _exists(store, digest, unknown):
        known, unknown = unknown, unknown * 2
    while unknown - known > 1:
        middle = (known + unknown) // 2
        if _exists(store, digest, middle):
            known = middle
        else:
            unknown = middle
    return known


def _exists(store: Store, digest: str, number: int) -> bool:
    try:
        read(store, "pipeline-run", _id(digest, number))
    except ResourceNotFound:
        return False
    return True


def _id(digest: str, number: int) -> str:
    return job_id("pipeline-run", _token(digest, number))


def _token(digest: str, number: int) -> str:
    return f"{digest}-{number}"
