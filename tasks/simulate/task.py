"""One chunk of a batch, and its audit, as Prefect tasks."""

from collections.abc import Callable, Mapping
from pathlib import Path

from prefect import task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE
from pydantic import JsonValue

from specs.field_types import OutputLocation
from tasks.simulate.audit.audit_report import AuditReport, AuditVerdict
from tasks.simulate.audit.audit_run import write_audit as audit_opened
from tasks.simulate.batch.chunk_runner import ChunkRunner
from tasks.simulate.batch.commit import ChunkEnd, WriteRecordings, run_chunk
from tasks.simulate.batch.job import load_batch
from tasks.storage.store_url import open_store

WriteOutput = Callable[[int, str], None]
_MARKS: Mapping[AuditVerdict, str] = {"SOUND": "✅", "SUSPECT": "❌", "NOT COMPARED": "❔", "NOT RUN": "❔"}


@task(name="simulate-chunk", task_run_name="simulate-chunk-{number}", cache_policy=NO_CACHE, persist_result=False)
def simulate_chunk(
    store_url: str,
    batch: str,
    number: int,
    *,
    bundles: dict[str, Path],
    lanes: int,
    left_s: float,
    spent_s: float,
    progress: Callable[[int], None],
    record: WriteRecordings | None,
    output: WriteOutput,
) -> ChunkEnd:
    """Returns how a chunk ended, its results being committed; one that was committed before is not simulated again.

    Args:
        store_url: Where the batch's record, worlds and chunks are.
        batch: The batch's id.
        number: The chunk's.
        bundles: Folder of each application's files, by digest.
        lanes: How many lanes fit into memory, as far as is known.
        left_s: Wall seconds that the batch has left; lanes that need longer are cancelled.
        spent_s: Wall seconds that were spent on the batch before.
        progress: Told how many of the chunk's episodes are done.
        record: Writes the chunk's recordings, for a batch that has any.
        output: Writes what applications printed during the chunk, if they printed anything.
    """
    work = load_batch(open_store(store_url), batch)
    runner = ChunkRunner(bundles, work.plan.engine, work.plan.recordings.rateHz, progress)
    ended = run_chunk(work, number, runner.run, record, lanes=lanes, left_s=left_s, spent_s=spent_s)
    if printed := "".join(runner.printed):
        output(number, printed)
    return ended


@task(name="audit-batch", cache_policy=NO_CACHE, persist_result=False)
def audit_batch(
    store_url: str,
    batch: str,
    *,
    bundles: dict[str, Path],
    location: OutputLocation,
    progress: Callable[[int], None],
) -> dict[str, JsonValue]:
    """Returns what the batch's record says of its audit.

    Args:
        store_url: Where the batch's record, worlds and chunks are.
        batch: The batch's id; all its chunks are committed.
        bundles: Folder of each application's files, by digest.
        location: The batch's output location.
        progress: Told how many episodes were driven again.
    """
    detail = audit_opened(load_batch(open_store(store_url), batch), bundles, location, progress)
    report = AuditReport.model_validate(detail["audit"])
    mark = _MARKS[report.verdict]
    body = f"# {mark} {report.verdict}\n\n{report.sentence}\n\nReport: `{detail['audit_url']}`"
    create_markdown_artifact(body, key="parity-audit")
    return detail
