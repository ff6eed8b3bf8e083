"""What is told of an export job has RoboMaker's shape and its request's words."""

from pydantic import JsonValue

from specs.base import Spec
from tasks.export.job.export_answers import describe_export_job, summarise_export_job
from tasks.storage.jobs.records import JobRecord

ARN = "arn:simyard:world-export-job:0123456789ab:wej-1"
WORLDS: list[JsonValue] = ["arn:simyard:world:0123456789ab:wgj-1/world-1-1"]
LOCATION: dict[str, JsonValue] = {"s3Bucket": "worlds", "s3Prefix": "nightly"}
ROLE = "arn:aws:iam::111122223333:role/export"
REQUEST: dict[str, JsonValue] = {
    "worlds": WORLDS,
    "outputLocation": LOCATION,
    "iamRole": ROLE,
    "tags": {"team": "yard"},
    "formats": ["mjcf"],
}
DONE = JobRecord(
    kind="world-export-job",
    id="wej-1",
    arn=ARN,
    token="t-1",  # noqa: S106 - of a client request
    request_digest="0" * 64,
    request=REQUEST,
    status="Completed",
    failure_code="",
    failure_reason="",
    created_at_s=1.5,
    updated_at_s=2.5,
    detail={"zip": "s3://worlds/nightly/wej-1.zip"},
)
FAILED = DONE.model_copy(
    update={"status": "Failed", "failure_code": "AccessDenied", "failure_reason": "the bucket refuses to be written"}
)


def as_json(document: Spec) -> dict[str, JsonValue]:
    return document.model_dump(mode="json", exclude_none=True)


def test_a_completed_job_is_described_without_a_failure():
    assert as_json(describe_export_job(DONE)) == {
        "arn": ARN,
        "status": "Completed",
        "createdAt": 1.5,
        "clientRequestToken": "t-1",
        "worlds": WORLDS,
        "outputLocation": LOCATION,
        "iamRole": ROLE,
        "tags": {"team": "yard"},
    }


def test_a_failed_job_is_described_with_code_and_reason():
    described = describe_export_job(FAILED)
    assert (described.failureCode, described.failureReason) == ("AccessDenied", "the bucket refuses to be written")


def test_a_job_in_a_list_has_its_worlds_and_place():
    assert as_json(summarise_export_job(DONE)) == {
        "arn": ARN,
        "status": "Completed",
        "createdAt": 1.5,
        "worlds": WORLDS,
        "outputLocation": LOCATION,
    }
