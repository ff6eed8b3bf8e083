"""A result that is written as JSON is the same value, of the same type, when Prefect reads it."""

import json

import pytest
from prefect._internal.result_records import ResultRecord, ResultRecordMetadata
from prefect.serializers import JSONSerializer

from flows.prefect.flow_calls import result_serializer
from flows.resources.abandoned_jobs import ReapedJob
from specs.base import Fault
from specs.data.run_report import PipelineReport, StageReport
from specs.errors import (
    DocumentError,
    PipelineNotPassed,
    ResourceNotFound,
    SimyardError,
    StageFailed,
    StoreUnreachable,
)
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import submit

STAGE = StageReport(name="gate", arn="", status="FAIL", summary="0.5", seconds=0.1, facts={"episodes": [1, {"a": 2}]})
REPORT = PipelineReport(run="run-1", name="nightly", stages=(STAGE,), verdict="FAIL", shipped=None)


def read_again(value: object) -> object:
    """Returns what another process gets: the file's bytes, and a serializer from what the state says of it."""
    written = result_serializer().dumps(value)
    told = ResultRecordMetadata(serializer=result_serializer()).dump_bytes()
    serializer = ResultRecordMetadata.load_bytes(told).serializer
    assert isinstance(serializer, JSONSerializer)
    return ResultRecord[object].deserialize(written, backup_serializer=serializer).result


def test_a_job_is_a_job_again(file_store: Store):
    record = submit(file_store, "world-generation-job", {"seed": 3, "tags": {"a": "b"}}, "tok")
    assert read_again(record) == record


@pytest.mark.parametrize("value", [REPORT, [ReapedJob(arn="a", was="Running", status="Failed", meaning="m")], []])
def test_a_report_and_a_list_are_the_same_again(value: object):
    assert read_again(value) == value


@pytest.mark.parametrize(
    "failure",
    [
        StageFailed("AccessDenied", "read-only: really", "arn:x"),
        DocumentError([Fault(path="a.b", value="1", allowed="2")], "nightly.yaml"),
        ResourceNotFound([Fault(path="a", value="b", allowed="c")]),
        PipelineNotPassed(REPORT),
        StoreUnreachable("nothing answers"),
        SimyardError("whatever"),
    ],
    ids=lambda failure: type(failure).__name__,
)
def test_an_exception_is_the_same_again_with_all_that_it_carries(failure: SimyardError):
    found = read_again(failure)
    assert type(found) is type(failure)
    assert str(found) == str(failure)
    assert vars(found) == vars(failure)


def test_an_exception_of_pythons_keeps_its_text():
    found = read_again(ValueError("no such thing"))
    assert isinstance(found, ValueError)
    assert str(found) == "no such thing"


def test_without_simyard_a_record_is_a_dictionary_with_its_arn(file_store: Store):
    record = submit(file_store, "world-generation-job", {}, "tok")
    assert json.loads(result_serializer().dumps(record))["data"]["arn"] == record.arn
