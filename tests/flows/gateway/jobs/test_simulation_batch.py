"""Batches of simulation jobs: started, described, cancelled."""

import pytest

from specs.errors import DocumentError, IdempotentParameterMismatch, LimitExceeded, ResourceNotFound
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.simulate.batch.batch_record import load_batch
from tasks.storage.jobs.queue import is_queued, leave_queue, queued_jobs
from tasks.storage.jobs.records import advance
from tests.flows.gateway.jobs.asked import Asked, path


def test_a_batch_is_recorded_with_its_plan_and_queued(asked: Asked):
    entries = [asked.job_request(asked.world(name), tags={"entry": name}) for name in ("a", "b")]
    policy = {"timeoutInSeconds": 600, "maxConcurrency": 1}
    made = asked.call(
        "StartSimulationJobBatch", createSimulationJobRequests=entries, batchPolicy=policy, tags={"night": "1"}
    )
    assert (made["status"], made["batchPolicy"], made["tags"]) == ("Pending", policy, {"night": "1"})
    assert is_queued(asked.store, BATCH, path(made))
    assert load_batch(asked.store, path(made)).layout.episodes == 2
    described = asked.call("DescribeSimulationJobBatch", batch=made["arn"])
    assert (described["createdRequests"], described["failedRequests"]) == ([], [])  # scripts count them
    assert [entry["tags"]["entry"] for entry in described["pendingRequests"]] == ["a", "b"]
    assert described["lastUpdatedAt"] >= described["createdAt"]


def test_the_same_token_with_other_requests_is_refused(asked: Asked):
    request = {"clientRequestToken": "t", "createSimulationJobRequests": [asked.job_request(asked.world())]}
    made = asked.call("StartSimulationJobBatch", **request)
    assert asked.call("StartSimulationJobBatch", **request) == made
    with pytest.raises(IdempotentParameterMismatch):
        asked.call("StartSimulationJobBatch", **request, tags={"a": "b"})


def test_a_batch_too_many_is_refused(asked: Asked, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MAX_BATCHES", "1")
    request = {"createSimulationJobRequests": [asked.job_request(asked.world())]}
    asked.call("StartSimulationJobBatch", **request)
    with pytest.raises(LimitExceeded):
        asked.call("StartSimulationJobBatch", **request)
    assert len(queued_jobs(asked.store)) == 1


def test_faults_stand_where_the_request_has_them(asked: Asked):
    good, bad = asked.job_request(asked.world()), asked.job_request(asked.world())
    del bad["simulationApplications"][0]["worldConfigs"]
    with pytest.raises(DocumentError, match="worldConfigs"):
        asked.call("StartSimulationJobBatch", createSimulationJobRequests=[bad])
    bad = asked.job_request(asked.world(), outputLocation={"s3Bucket": "others"})
    good["outputLocation"] = {"s3Bucket": "results"}
    with pytest.raises(DocumentError) as refused:
        asked.call("StartSimulationJobBatch", createSimulationJobRequests=[good, bad])
    assert [fault.path for fault in refused.value.faults] == ["createSimulationJobRequests[*].outputLocation"]


def test_a_cancelled_batch_waits_for_a_worker_and_is_said_to_be_canceling(asked: Asked):
    made = asked.call("StartSimulationJobBatch", createSimulationJobRequests=[asked.job_request(asked.world())])
    leave_queue(asked.store, BATCH, path(made))  # as a batch of a document's run that was killed
    for _ in range(2):
        assert asked.call("CancelSimulationJobBatch", batch=made["arn"]) == {}
    assert [entry.id for entry in queued_jobs(asked.store)] == [path(made)]
    assert asked.call("DescribeSimulationJobBatch", batch=made["arn"])["status"] == "Canceling"
    advance(asked.store, BATCH, path(made), "Canceled")
    with pytest.raises(DocumentError):
        asked.call("CancelSimulationJobBatch", batch=made["arn"])


@pytest.mark.parametrize("operation", ["DescribeSimulationJobBatch", "CancelSimulationJobBatch"])
def test_a_batch_that_is_not_there_is_not_found(operation: str, asked: Asked):
    with pytest.raises(ResourceNotFound):
        asked.call(operation, batch=asked.arn(BATCH, "simb-0000000000000000"))
