"""What a flow run's state says of the work, in one line, and that the work itself is the flow's result."""

import base64
import json
import pickle
import re
from collections.abc import Callable
from contextlib import suppress
from io import StringIO
from logging import StreamHandler
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace
from typing import cast
from uuid import uuid4

import pytest
from prefect import flow_engine
from prefect._internal.result_records import ResultRecord, ResultRecordMetadata
from prefect.client.schemas.objects import FlowRun, State, StateType
from prefect.engine import engine_logger
from prefect.logging import get_logger
from prefect.logging.loggers import flow_run_logger
from prefect.serializers import JSONSerializer
from prefect.states import Cancelled
from pydantic import JsonValue, ValidationError

from flows.prefect.flow_calls import (
    completed_job,
    completed_reaping,
    completed_run,
    leave_heartbeats,
    result_of,
    result_serializer,
    tell_failures_once,
)
from flows.resources.abandoned_jobs import ReapedJob
from specs.base import Fault
from specs.data.run_report import PipelineReport, StageName, StageReport
from specs.errors import (
    DocumentError,
    ObjectCorrupt,
    PipelineNotPassed,
    ResourceNotFound,
    SimyardError,
    StageFailed,
    StoreUnreachable,
)
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit

BATCH: dict[str, JsonValue] = {"passed": 380, "episodes": 384, "simulated_s": 12.0}


def job(store: Store, kind: JobKind, status: str, detail: dict[str, JsonValue], reason: str = "") -> JobRecord:
    record = submit(store, kind, {}, "tok")
    return advance(store, kind, record.id, status, detail=detail, failure_reason=reason)


def state(result: object) -> State[object]:
    return cast("State[object]", result)


def stage(name: StageName, summary: str, status: str = "Completed") -> StageReport:
    return StageReport(name=name, arn="", status=status, summary=summary, seconds=0.1)


@pytest.mark.parametrize(
    ("kind", "status", "detail", "message"),
    [
        (
            "world-generation-job",
            "PartialFailed",
            {"worlds": ["w/1", "w/2"], "failures": {"ResourceNotFound": {"count": 1}}},
            "PartialFailed: 2 worlds, 1 failed: {arn}",
        ),
        ("world-export-job", "Completed", {"zip": "s3://b/x.zip"}, "1 zip: s3://b/x.zip ({arn})"),
        ("simulation-job-batch", "Completed", BATCH, "380 of 384 episodes passed, 12 simulated seconds: {arn}"),
        ("deployment-job", "Succeeded", {}, "no robot was asked to run a version: {arn}"),
    ],
)
def test_a_jobs_state_says_what_it_made_and_where(
    file_store: Store, kind: JobKind, status: str, detail: dict[str, JsonValue], message: str
):
    record = job(file_store, kind, status, detail)
    found = state(completed_job(record))

    assert found.is_completed()
    assert found.message == message.format(arn=record.arn)
    assert found.data == record


def test_the_state_of_a_cancelled_flow_run_stays_as_it_is():
    canceled = Cancelled(message="canceled on request")
    assert state(completed_job(cast("JobRecord", canceled))) is canceled
    assert state(completed_run(cast("PipelineReport", canceled))) is canceled


def test_a_runs_state_has_the_verdict_and_the_first_figures_of_each_stage():
    stages = (
        stage("worldGeneration", "8 worlds"),
        stage("simulationBatch", "380 of 384 episodes passed, 12 simulated seconds; audit SOUND"),
        stage("gate", "success rate 0.99", "PASS"),
        stage("deployment", "5 of 5 robots run courier 1; UNSIGNED", "Succeeded"),
    )
    report = PipelineReport(run="run-1", name="nightly", stages=stages, verdict="PASS", shipped=True)

    assert state(completed_run(report)).message == (
        "PASS, shipped: 8 worlds; 380 of 384 episodes passed, 12 simulated seconds; 5 of 5 robots run courier 1 (run-1)"
    )


def test_a_run_without_a_gate_has_no_verdict_in_its_message():
    report = PipelineReport(run="run-1", name="worlds", stages=(stage("worldGeneration", "2 worlds"),))
    assert state(completed_run(report)).message == "2 worlds (run-1)"


def test_a_failed_gates_message_has_the_rule_and_its_figures():
    stages = (stage("gate", "success rate 0.61 to 0.70, at least 0.9 wanted", "FAIL"),)
    failure = PipelineNotPassed(PipelineReport(run="run-1", name="nightly", stages=stages, verdict="FAIL"))
    assert str(failure) == "nightly: the gate says FAIL: success rate 0.61 to 0.70, at least 0.9 wanted (run-1)"


def test_a_failed_roll_outs_message_has_the_robots():
    stages = (stage("gate", "all well", "PASS"), stage("deployment", "1 of 5 robots runs courier 2", "Failed"))
    report = PipelineReport(run="run-1", name="nightly", stages=stages, verdict="PASS", shipped=False)
    assert str(PipelineNotPassed(report)) == "nightly: the deployment failed: 1 of 5 robots runs courier 2 (run-1)"


def test_reaping_counts_what_became_of_the_jobs():
    found = [ReapedJob(arn=str(n), was="Running", status=status, meaning="") for n, status in enumerate("AAB")]
    assert state(completed_reaping(found)).message == "3 abandoned jobs: 2 now A, 1 now B"
    assert state(completed_reaping([])).message == "no abandoned job"


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


def stored(tmp_path: Path, body: bytes) -> State[object]:
    """Returns the state of a flow run whose result lies in a file, as a client of the server reads it."""
    (tmp_path / "result").write_bytes(body)
    told = ResultRecordMetadata(storage_key=str(tmp_path / "result"), serializer=result_serializer())
    return State(type=StateType.COMPLETED, data=told)


@pytest.mark.parametrize("value", [REPORT, [ReapedJob(arn="a", was="Running", status="Failed", meaning="m")], []])
def test_a_result_that_a_flow_of_simyards_has_written_is_read(tmp_path: Path, value: object):
    assert result_of(stored(tmp_path, result_serializer().dumps(value))) == value
    assert result_of(state(completed_reaping([]))) == []


@pytest.mark.parametrize("failure", [StageFailed("AccessDenied", "read-only", "arn:x"), ValueError("no such thing")])
def test_what_a_flow_of_simyards_has_failed_with_is_raised(tmp_path: Path, failure: Exception):
    with pytest.raises(type(failure), match=re.escape(str(failure))):
        result_of(stored(tmp_path, result_serializer().dumps(failure)))


class _Pickled:
    def __init__(self, mark: Path) -> None:
        self._mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self._mark,)


def _as_pickle(mark: Path) -> bytes:
    pickled = base64.b64encode(pickle.dumps(_Pickled(mark))).decode()
    return json.dumps({"metadata": {"serializer": {"type": "pickle"}}, "result": pickled}).encode()


def _as_function(mark: Path) -> bytes:
    return json.dumps({"__class__": "subprocess.call", "data": [["touch", str(mark)]], "metadata": None}).encode()


def _as_part_of_a_report(mark: Path) -> bytes:
    report = json.loads(result_serializer().dumps(REPORT))
    report["data"]["stages"][0]["facts"] = json.loads(_as_function(mark))
    return json.dumps(report).encode()


@pytest.mark.parametrize("write", [_as_pickle, _as_function, _as_part_of_a_report])
def test_a_result_that_a_stranger_has_written_calls_nothing(tmp_path: Path, write: Callable[[Path], bytes]):
    mark = tmp_path / "called"
    hostile = stored(tmp_path, write(mark))
    with suppress(ObjectCorrupt):
        result_of(hostile)
    assert not mark.exists()
    with suppress(ValidationError, TypeError):
        hostile.result(retry_result_failure=False)
    assert mark.exists(), "Prefect calls it no more: is result_of still needed?"


@pytest.mark.parametrize(
    "body", [b"", b"null", b"{}", b"3", b'"text"', b"[" * 100_000, b'{"__class__": "x", "data": 1}']
)
def test_what_no_flow_of_simyards_returns_is_refused(tmp_path: Path, body: bytes):
    with pytest.raises(ObjectCorrupt, match="result"):
        result_of(stored(tmp_path, body))


@pytest.fixture
def joined(monkeypatch: pytest.MonkeyPatch) -> list[Thread]:
    """Returns the threads that somebody has waited for since; restores what Prefect does at the end."""
    threads: list[Thread] = []
    monkeypatch.setattr(Thread, "join", lambda thread, **_: threads.append(thread))
    monkeypatch.setattr(flow_engine, "_send_heartbeats", flow_engine._send_heartbeats)
    return threads


def run_flow() -> None:
    """Runs the block in which an engine sends heartbeats, until the first was sent."""
    sent = Event()
    engine = SimpleNamespace(
        heartbeat_seconds=30,
        flow_run=None,
        logger=get_logger("test"),
        _build_heartbeat_event_template=lambda: ({}, []),
        _emit_flow_run_heartbeat=lambda *_: sent.set(),
    )
    with flow_engine._send_heartbeats(engine):  # pyright: ignore[reportArgumentType]
        assert sent.wait()


def test_a_flow_waits_for_its_heartbeats_as_prefect_has_it(joined: list[Thread]):
    run_flow()
    assert len(joined) == 1


def test_a_flow_does_not_wait_for_heartbeats_that_it_leaves(joined: list[Thread]):
    leave_heartbeats()
    leave_heartbeats()
    run_flow()
    assert joined == []


@pytest.mark.parametrize(
    ("failure", "debug", "is_traced"),
    [
        (PipelineNotPassed(REPORT), "", False),
        (PipelineNotPassed(REPORT), "1", True),
        (StageFailed("InternalServiceError", "because"), "", False),
        (ZeroDivisionError("a defect"), "", True),
    ],
)
def test_a_verdict_is_logged_without_a_traceback_and_a_defect_with_one(
    monkeypatch: pytest.MonkeyPatch, failure: Exception, debug: str, *, is_traced: bool
):
    monkeypatch.setenv("SIMYARD_DEBUG", debug)
    told = StringIO()
    loggers = [flow_run_logger(FlowRun(flow_id=uuid4())).logger, engine_logger]  # those of flow_engine and of workers
    tell_failures_once()
    for logger in loggers:
        monkeypatch.setattr(logger, "handlers", [StreamHandler(told)])  # and not the one that asks for a server
    try:
        raise failure
    except type(failure) as exc:
        for logger in loggers:
            logger.error("it ended with %r", exc, exc_info=True)
    assert told.getvalue().count("it ended with") == 2
    assert told.getvalue().count("Traceback") == 2 * is_traced
