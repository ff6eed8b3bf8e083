"""How a program calls a flow of Simyard's, and what comes back: results and exceptions, as JSON between processes.

A flow returns the state in the place of its result, with one line that says what came of it. Prefect makes the state's
data the flow's result again. Prefect's own JSON keeps of an exception its class and text, and calls the class with the
text. Simyard's exceptions have more than a text: the code of a stage, the faults of a document, the report of a run. So
this module writes what an exception was made of.
"""

import json
import logging
import os
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

from prefect import flow_engine, settings
from prefect._internal.result_records import ResultRecordMetadata
from prefect.client.schemas.objects import State
from prefect.context import FlowRunContext, TaskRunContext
from prefect.exceptions import CancelledRun
from prefect.filesystems import LocalFileSystem
from prefect.logging.configuration import ensure_logging_setup
from prefect.logging.handlers import PrefectConsoleHandler
from prefect.results import get_default_result_storage, resolve_result_storage
from prefect.serializers import JSONSerializer, prefect_json_object_encoder
from prefect.states import Completed
from prefect.utilities.importtools import to_qualified_name
from pydantic import AfterValidator, JsonValue, TypeAdapter

from flows.pipeline.stage_report import job_summary
from flows.resources.abandoned_jobs import ReapedJob
from specs.base import Fault, Spec
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, ObjectCorrupt, PipelineNotPassed, SimyardError, StageFailed
from tasks.storage.jobs.records import JobRecord

# Prefect 3.8 takes whatever has "data" for a record of its older format, and would give the data alone, as a dictionary
# (docs/reference/prefect.md, section 8). No record has such metadata; the decoder does not look at them.
_NO_RECORD: dict[str, JsonValue] = {"metadata": None}


T = TypeVar("T")


class FailureParts(Spec):
    """What an exception was made of.

    Attributes:
        error: The name of its class in ``specs.errors``.
        text: What it says.
        code: Of a stage that failed.
        reason: Of a stage that failed.
        arn: Of a stage that failed.
        faults: Of a document.
        source: Of a document.
        report: Of a run that did not pass.
    """

    error: str
    text: str
    code: str = ""
    reason: str = ""
    arn: str = ""
    faults: tuple[Fault, ...] = ()
    source: str = ""
    report: PipelineReport | None = None


def encode_result(value: object) -> JsonValue:
    """Returns what JSON has no word for as JSON: a document, or an exception. Prefect calls it."""
    if isinstance(value, SimyardError):
        return {"__class__": f"{__name__}.Failure", "data": _parts(value).model_dump(mode="json"), **_NO_RECORD}
    encoded: dict[str, JsonValue] = prefect_json_object_encoder(value)
    return {**encoded, **_NO_RECORD}


def _parts(failure: SimyardError) -> FailureParts:
    parts: dict[str, object] = {"error": type(failure).__name__, "text": str(failure)}
    if isinstance(failure, StageFailed):
        parts |= {"code": failure.code, "reason": failure.reason, "arn": failure.arn}
    elif isinstance(failure, DocumentError):
        parts |= {"faults": failure.faults, "source": failure.source}
    elif isinstance(failure, PipelineNotPassed):
        parts |= {"report": failure.report}
    return FailureParts.model_validate(parts)


def _failure(parts: FailureParts) -> SimyardError:
    kind = _kinds(SimyardError).get(parts.error, SimyardError)
    if issubclass(kind, StageFailed):
        return kind(parts.code, parts.reason, parts.arn)
    if issubclass(kind, DocumentError):
        return kind(parts.faults, parts.source)
    if parts.report is not None:
        return PipelineNotPassed(parts.report)
    return cast("Callable[[str], SimyardError]", kind)(parts.text)


def _kinds(base: type[SimyardError]) -> dict[str, type[SimyardError]]:
    found = {base.__name__: base}
    for below in base.__subclasses__():
        found |= _kinds(below)
    return found


Failure = Annotated[FailureParts, AfterValidator(_failure)]
"""What Prefect's decoder makes an exception of."""


_READ: Mapping[str, TypeAdapter[Any]] = {
    f"{__name__}.Failure": TypeAdapter(Failure),
    **{to_qualified_name(kind): TypeAdapter(kind) for kind in (JobRecord, PipelineReport, ReapedJob)},
}
"""All that a flow of Simyard's returns or raises, by the name that stands in a stored result."""


# Prefect's own state.result() reads a stored result as that result itself says: by pickle, by any function that can be
# imported, or with a class that is called. Whoever can write to the storage of results runs code by that.
def result_of(state: State[T]) -> T:
    """Returns what a flow run of Simyard's came to, read as Simyard writes it and in no other way.

    Args:
        state: Of the flow run, such as a client of Prefect's server reads it.

    Raises:
        SimyardError: What the run failed with.
        ObjectCorrupt: What is stored is nothing that a flow of Simyard's returns or raises.
    """
    told = state.data
    if not isinstance(told, ResultRecordMetadata):
        return state.result()  # it is here, or there is none: nothing is read
    key = told.storage_key or ""
    if told.storage_block_id is not None:
        storage = _at_once(resolve_result_storage, told.storage_block_id)
    elif Path(key).is_absolute():
        storage = LocalFileSystem(basepath=str(Path(key).parent))
    else:
        storage = _at_once(get_default_result_storage)
    found = _read_result(_at_once(storage.read_path, key), key)
    if isinstance(found, Exception):
        raise found
    return cast("T", found)


def _at_once(call: Callable[..., Any], *given: object) -> Any:  # noqa: ANN401 - whatever Prefect returns
    """Returns what a function of Prefect's returns; in a thread of an async flow it would return a coroutine."""
    return call(*given, _sync=True)


def _read_result(body: bytes, key: str) -> object:
    try:
        found = json.loads(body, object_hook=_read_object)
    except (ValueError, LookupError, TypeError, RecursionError) as exc:
        raise ObjectCorrupt(
            f"the result {key} was not written by this version of Simyard: {type(exc).__name__}"
        ) from exc
    listed = cast("list[object]", found) if isinstance(found, list) else [found]
    if not all(isinstance(each, JobRecord | PipelineReport | ReapedJob | Exception) for each in listed):
        raise ObjectCorrupt(f"the result {key} is nothing that a flow of Simyard's returns")
    return found


def _read_object(given: dict[str, Any]) -> object:
    """Returns what a dictionary of a stored result stands for; nothing that it names is looked up."""
    if known := _READ.get(str(given.get("__class__"))):
        return known.validate_python(given["data"])
    if "__exc_type__" in given:
        name = str(given["__exc_type__"]).rpartition(".")[2]
        kind = {each.__name__: each for each in (ValueError, TypeError, KeyError, OSError, RuntimeError)}.get(name)
        return kind(given["message"]) if kind else SimyardError(f"{name}: {given['message']}")
    return given


def result_serializer() -> JSONSerializer:
    """Returns how Prefect shall write the results of a flow."""
    return JSONSerializer(object_encoder=f"{__name__}.{encode_result.__name__}")


_SUCCESS = frozenset({"Completed", "Succeeded"})


# A flow returns the state in the place of its result. Prefect makes the state's data the flow's result again: for who
# calls the flow in Python, for who waits for its deployment's run, and for who reads the state later.
def completed_job(record: JobRecord) -> JobRecord:
    """Returns the state of a flow run that ended a job; one that Prefect shall take as it is stays as it is.

    Args:
        record: The job, or the state of a flow run that was cancelled.
    """
    if isinstance(cast("object", record), State):
        return record
    status = "" if record.status in _SUCCESS else f"{record.status}: "
    zipped = record.detail.get("zip")
    where = f"{zipped} ({record.arn})" if zipped else record.arn
    return _completed(record, f"{status}{job_summary(record)}: {where}")


def completed_run(report: PipelineReport) -> PipelineReport:
    """Returns the state of a flow run that ran a document to its end.

    Args:
        report: Of the run, or the state of a flow run that was cancelled.
    """
    if isinstance(cast("object", report), State):
        return report
    return _completed(report, run_sentence(report))


def completed_reaping(found: Sequence[ReapedJob]) -> list[ReapedJob]:
    """Returns the state of a flow run that looked for abandoned jobs."""
    statuses = Counter(each.status for each in found)
    counts = ", ".join(f"{number} now {status}" for status, number in sorted(statuses.items()))
    number = f"{len(found)} abandoned job{'' if len(found) == 1 else 's'}"
    return _completed([*found], f"{number}: {counts}" if found else "no abandoned job")


def run_sentence(report: PipelineReport) -> str:
    """Returns a run in one line: the verdict, whether anything was shipped, and the first figures of each stage."""
    shipped = {True: "shipped", False: "not shipped", None: ""}[report.shipped]
    answer = ", ".join(part for part in (report.verdict or "", shipped) if part)
    counts = "; ".join(stage.summary.partition("; ")[0] for stage in report.stages if stage.name != "gate")
    return ": ".join(part for part in (answer, counts) if part) + f" ({report.run})"


def _completed(data: T, message: str) -> T:
    return cast("T", Completed(data=data, message=message))


_silent: ContextVar[bool] = ContextVar("simyard_silent", default=False)


def is_in_flow_run() -> bool:
    """Returns whether the caller is a flow or a task of Prefect's, which has a server."""
    return FlowRunContext.get() is not None or TaskRunContext.get() is not None


@contextmanager
def call_flow_at(server: Mapping[str, str]) -> Generator[None, None, None]:
    """Lets a program call a flow in the block.

    Prefect uses the server, also where it was imported before there was one. What the flow logs is on its page, and not
    on the program's console.

    Args:
        server: The variables by which Prefect reaches it.
    """
    known: dict[Any, str] = {getattr(settings, name): value for name, value in server.items()}
    with settings.temporary_settings(known), _silent_console():
        yield


@contextmanager
def canceled_as_failure() -> Generator[None, None, None]:
    """Raises what Prefect raises for a cancelled flow run as Simyard's own exception.

    Raises:
        StageFailed: Somebody cancelled it.
    """
    try:
        yield
    except CancelledRun as exc:
        raise StageFailed("Canceled", str(exc)) from exc


@contextmanager
def _silent_console() -> Generator[None, None, None]:
    ensure_logging_setup()
    token = _silent.set(True)
    for handler in logging.getLogger().handlers:
        if isinstance(handler, PrefectConsoleHandler):
            handler.addFilter(_is_shown)  # once, however many runs there are
    try:
        yield
    finally:
        _silent.reset(token)


def _is_shown(record: logging.LogRecord) -> bool:
    """Returns whether a line is of another flow, such as one of the program's own, or grave."""
    return not _silent.get() or record.levelno >= logging.CRITICAL


def tell_failures_once() -> None:
    """Makes Prefect log what a flow of Simyard's failed with in its own words, without the way through Prefect.

    A gate that says FAIL is no defect. The engine logs a traceback of it, and once more where a worker started it; the
    exception itself goes on as before. SIMYARD_DEBUG=1 keeps the tracebacks.
    """
    for name in ("prefect.flow_runs", "prefect.engine"):
        logging.getLogger(name).addFilter(_in_own_words)  # once, however many runs there are


def _in_own_words(record: logging.LogRecord) -> bool:
    failure = record.exc_info[1] if record.exc_info else None
    if isinstance(failure, SimyardError) and os.environ.get("SIMYARD_DEBUG") != "1":
        record.exc_info = None
    return True


def leave_heartbeats() -> None:
    """Makes each later sync flow of this process end without waiting for its heartbeat thread.

    The thread sleeps for a second at a time, and a sync flow waits for its end; three flows in one another wait 1.7 s
    (docs/reference/prefect.md, section 3). Prefect's async flows do not wait, and nothing is lost: a thread that wakes
    up after its flow sends nothing.
    """
    # Prefect has no setting for this: the argument is there, and only its own callers choose it.
    sent = flow_engine._send_heartbeats  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    if not isinstance(sent, partial):
        flow_engine._send_heartbeats = partial(sent, join_on_exit=False)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
