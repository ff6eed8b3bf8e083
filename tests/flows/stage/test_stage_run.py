"""What a stage that did not end well says, and whose result one tells that has waited."""

import pytest

from flows.pipeline.orchestrator import Orchestrator, orchestrated_by
from flows.pipeline.run_turns import require_success, run_stage
from specs.errors import StageFailed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, records, submit

EXPORT = "world-export-job"


def test_a_canceled_job_says_that_somebody_asked_for_it(file_store: Store):
    job = submit(file_store, "world-generation-job", {}, "token").id
    advance(file_store, "world-generation-job", job, "Canceling")
    with pytest.raises(StageFailed, match=r"^Canceled: canceled on request"):
        require_success(advance(file_store, "world-generation-job", job, "Canceled"))


def test_a_flow_run_that_left_its_place_and_came_again_does_not_do_the_work_a_second_time(file_store: Store):
    class ComeAgain(Orchestrator):
        def awaited_run(self) -> str:
            return records(file_store, "pipeline-run")[0].id

    def work(token: str) -> JobRecord:
        job = submit(file_store, EXPORT, {}, token).id
        return advance(file_store, EXPORT, job, "Failed")  # of which no assets are told

    first = run_stage(file_store, "world-export", {"spec": {}}, None, work)
    with orchestrated_by(ComeAgain()):
        assert run_stage(file_store, "world-export", {"spec": {}}, None, work).id == first.id
    assert run_stage(file_store, "world-export", {"spec": {}}, None, work).id != first.id
