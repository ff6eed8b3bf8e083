"""The look of who hands jobs to a work pool."""

from flows.queue.pool import look_at_all
from specs.errors import StoreError
from tasks.storage.jobs.queue import QueueEntry


def test_a_job_that_cannot_be_looked_at_keeps_nobody_from_the_others():
    seen = list[str]()

    def look(entry: QueueEntry) -> None:
        seen.append(entry.id)
        if entry.id == "damaged":
            raise StoreError("its record is no JSON")

    look_at_all(look, [QueueEntry(kind="deployment-job", id=name, queued_at_s=1.0) for name in ("damaged", "whole")])

    assert seen == ["damaged", "whole"]
