"""Simulation jobs and their batches: asked for, described, cancelled, restarted."""

from pathlib import Path
from typing import Any

import pytest

from specs.errors import DocumentError, IdempotentParameterMismatch, LimitExceeded, ResourceNotFound, TrustRefused
from tasks.deploy.trust.trust_record import require_vouched
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.simulate.batch.batch_record import load_batch
from tasks.simulate.batch.chunk_store import begin_chunk
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.queue import is_queued, leave_queue, queued_jobs
from tasks.storage.jobs.records import advance, read
from tests.flows.gateway.asked import ROLE, Asked, path


def _batch(answer: dict[str, Any]) -> str:
    return path(answer).partition("/")[0]


def test_a_job_is_recorded_and_queued_and_the_workers_are_told(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world(), clientRequestToken="a"))
    assert (made["status"], made["clientRequestToken"], made["iamRole"]) == ("Pending", "a", ROLE)
    assert path(made).endswith("/0")
    assert is_queued(asked.store, BATCH, _batch(made))
    assert asked.woken == 1


def test_the_gateway_vouches_for_a_job_so_that_a_worker_with_keys_takes_it(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world(), clientRequestToken="a"))
    record = read(asked.store, BATCH, _batch(made))
    assert require_vouched(record, sync=True).digest == ""
    with pytest.raises(TrustRefused):
        require_vouched(record.model_copy(update={"request": {**record.request, "plan": {}}}), sync=True)


def test_what_has_no_effect_is_kept_and_answered(asked: Asked):
    kept = {
        "vpcConfig": {"subnets": ["subnet-1"], "securityGroups": ["sg-1"], "assignPublicIp": True},
        "compute": {"simulationUnitLimit": 3, "computeType": "CPU", "gpuUnitLimit": 0},
        "loggingConfig": {"recordAllRosTopics": False},
        "tags": {"team": "blue"},
        "outputLocation": {"s3Bucket": "results", "s3Prefix": "nightly"},
        "failureBehavior": "Continue",
    }
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world(), **kept))
    described = asked.call("DescribeSimulationJob", job=made["arn"])
    for answer in (made, described):
        assert {name: answer[name] for name in kept} == kept
    assert set(made) < set(described)


def test_a_job_says_which_content_of_its_files_it_reads(asked: Asked):
    bucket = open_bucket(asked.store, "maps")
    bucket.put("one.yaml", b"walls: []\n")
    source = {"name": "maps", "s3Bucket": "maps", "s3Keys": ["one.yaml"], "type": "File"}
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world(), dataSources=[source]))
    described = asked.call("DescribeSimulationJob", job=made["arn"])
    etag = bucket.etag("one.yaml").strip('"')
    for answer in (made, described):
        assert answer["dataSources"][0]["s3Keys"] == [{"s3Key": "one.yaml", "etag": etag}]


def test_tags_are_those_that_the_job_has_now(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world(), tags={"team": "blue"}))
    asked.call("TagResource", resourceArn=made["arn"], tags={"shift": "night"})
    told = asked.call("BatchDescribeSimulationJob", jobs=[made["arn"]])["jobs"][0]["tags"]
    assert told == {"team": "blue", "shift": "night"}
    asked.call("UntagResource", resourceArn=made["arn"], tagKeys=["team", "shift"])
    assert asked.call("DescribeSimulationJob", job=made["arn"])["tags"] == {}


def test_the_same_call_again_is_the_same_job_whatever_was_published_since(asked: Asked, tmp_path: Path):
    request = asked.job_request(asked.world(), clientRequestToken="a")
    made = asked.call("CreateSimulationJob", **request)
    folder = tmp_path / "courier"
    folder.mkdir()
    (folder / "other.txt").write_text("another bundle")
    asked.publish(folder)
    assert asked.call("CreateSimulationJob", **request) == made
    with pytest.raises(IdempotentParameterMismatch, match=_batch(made)):
        asked.call("CreateSimulationJob", **{**request, "maxJobDurationInSeconds": 61})


def test_a_call_without_a_token_is_a_job_of_its_own_each_time(asked: Asked):
    request = asked.job_request(asked.world())
    assert asked.call("CreateSimulationJob", **request)["arn"] != asked.call("CreateSimulationJob", **request)["arn"]


def test_its_batch_is_none_to_robomaker(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world()))
    for operation in ("DescribeSimulationJobBatch", "CancelSimulationJobBatch"):
        with pytest.raises(ResourceNotFound):
            asked.call(operation, batch=asked.arn(BATCH, _batch(made)))


def test_a_job_goes_from_pending_over_preparing_to_running(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world()))

    def status() -> str:
        return asked.call("DescribeSimulationJob", job=made["arn"])["status"]

    seen = [status()]
    advance(asked.store, BATCH, _batch(made), "InProgress")
    seen.append(status())
    begin_chunk(asked.store, _batch(made), 0, 0.0)
    assert [*seen, status()] == ["Pending", "Preparing", "Running"]


def test_a_job_without_a_world_is_refused_in_the_words_of_the_request(asked: Asked):
    request = asked.job_request(asked.world())
    del request["simulationApplications"][0]["worldConfigs"]
    with pytest.raises(DocumentError, match="worldConfigs"):
        asked.call("CreateSimulationJob", **request)


@pytest.mark.parametrize("what", ["application", "world"])
def test_what_a_job_needs_and_is_not_there_is_not_found_and_nothing_is_queued(what: str, asked: Asked):
    request = asked.job_request(asked.arn("world", "hand/none") if what == "world" else asked.world())
    if what == "application":
        request["robotApplications"][0]["application"] = asked.arn("robot-application", "nobody")
    with pytest.raises(ResourceNotFound) as refused:
        asked.call("CreateSimulationJob", **request)
    assert not any(fault.path.startswith("simulationBatch") for fault in refused.value.faults)
    assert queued_jobs(asked.store) == []


def test_a_launch_file_that_is_not_in_the_bundle_is_refused(asked: Asked):
    request = asked.job_request(asked.world())
    request["robotApplications"][0]["launchConfig"]["launchFile"] = "nothing"
    with pytest.raises(DocumentError, match="launchFile") as refused:
        asked.call("CreateSimulationJob", **request)
    assert [fault.path for fault in refused.value.faults] == ["launchConfig.launchFile"]


def test_one_more_than_the_quota_is_refused_and_a_repeated_call_is_not(asked: Asked, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MAX_SIMULATION_JOBS", "1")
    request = asked.job_request(asked.world(), clientRequestToken="a")
    made = asked.call("CreateSimulationJob", **request)
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_SIMULATION_JOBS"):
        asked.call("CreateSimulationJob", **{**request, "clientRequestToken": "b"})
    assert asked.call("CreateSimulationJob", **request) == made
    assert [entry.id for entry in queued_jobs(asked.store)] == [_batch(made)]
    asked.call("StartSimulationJobBatch", createSimulationJobRequests=[asked.job_request(asked.world())])
    advance(asked.store, BATCH, _batch(made), "Completed")
    assert asked.call("CreateSimulationJob", **{**request, "clientRequestToken": "b"})["status"] == "Pending"


def test_several_jobs_are_described_and_those_that_are_gone_are_told(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world()))
    gone = asked.arn("simulation-job", "simb-0000000000000000/0")
    answer = asked.call("BatchDescribeSimulationJob", jobs=[made["arn"], gone])
    assert [job["arn"] for job in answer["jobs"]] == [made["arn"]]
    assert answer["unprocessedJobs"] == [gone]
    with pytest.raises(ResourceNotFound):
        asked.call("BatchDescribeSimulationJob", jobs=[asked.fleet()])


def test_a_cancelled_job_that_nobody_has_begun_is_canceled(asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world()))
    assert asked.call("CancelSimulationJob", job=made["arn"]) == {}
    assert asked.call("DescribeSimulationJob", job=made["arn"])["status"] == "Canceled"
    assert is_queued(asked.store, BATCH, _batch(made))  # a worker writes its row


def test_only_a_running_job_is_restarted(asked: Asked, monkeypatch: pytest.MonkeyPatch):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world()))
    with pytest.raises(DocumentError, match="Pending"):
        asked.call("RestartSimulationJob", job=made["arn"])
    advance(asked.store, BATCH, _batch(made), "InProgress")
    begin_chunk(asked.store, _batch(made), 0, 0.0)
    assert asked.call("RestartSimulationJob", job=made["arn"]) == {}
    assert asked.call("DescribeSimulationJob", job=made["arn"])["status"] == "Restarting"
    asked.call("CreateSimulationJob", **asked.job_request(asked.world()))
    monkeypatch.setenv("SIMYARD_MAX_SIMULATION_JOBS", "1")
    with pytest.raises(LimitExceeded):
        asked.call("RestartSimulationJob", job=made["arn"])


@pytest.mark.parametrize("operation", ["DescribeSimulationJob", "CancelSimulationJob", "RestartSimulationJob"])
@pytest.mark.parametrize("place", ["simb-0000000000000000/0", "{batch}/1", "{batch}/x"])
def test_a_job_that_is_not_there_is_not_found(operation: str, place: str, asked: Asked):
    made = asked.call("CreateSimulationJob", **asked.job_request(asked.world()))
    with pytest.raises(ResourceNotFound):
        asked.call(operation, job=asked.arn("simulation-job", place.format(batch=_batch(made))))


@pytest.mark.parametrize("tags", [{"simyard:outcome": "Passed"}, {f"t{n}": "" for n in range(49)}])
def test_the_tags_of_an_outcome_are_nobody_elses(tags: dict[str, str], asked: Asked):
    with pytest.raises(DocumentError, match="tags"):
        asked.call("CreateSimulationJob", **asked.job_request(asked.world(), tags=tags))


def test_a_record_says_what_was_asked_for_and_its_plan(asked: Asked):
    request = asked.job_request(asked.world(), clientRequestToken="a")
    made = asked.call("CreateSimulationJob", **request)
    record = read(asked.store, BATCH, _batch(made))
    assert record.request["request"] == request
    assert load_batch(asked.store, record.id).layout.episodes == 1


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
