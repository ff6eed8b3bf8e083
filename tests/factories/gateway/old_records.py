"""Records as other versions of Simyard may have left them, which this one does not write."""

from specs.job_kinds import JobKind
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import read


def fail_with_code(store: Store, kind: JobKind, job: str, code: str, reason: str) -> None:
    """Lets a job have failed with any code, also with one of another kind."""
    failed = {"status": "Failed", "failure_code": code, "failure_reason": reason}
    store.put(job_key(kind, job), encode_document(read(store, kind, job).model_copy(update=failed)))
