"""What a stage that did not end well says."""

import pytest

from flows.stage.stage_run import require_success
from specs.errors import StageFailed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance, submit


def test_a_canceled_job_says_that_somebody_asked_for_it(file_store: Store):
    job = submit(file_store, "world-generation-job", {}, "token").id
    advance(file_store, "world-generation-job", job, "Canceling")
    with pytest.raises(StageFailed, match=r"^Canceled: canceled on request"):
        require_success(advance(file_store, "world-generation-job", job, "Canceled"))
