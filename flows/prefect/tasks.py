"""The steps of a batch, and its gate, as Prefect tasks with their artifacts.

They are here and not in a capability's `task.py`, because each joins several capabilities (`flows.batch.batch_steps`).
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from prefect import task
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE
from pydantic import JsonValue

from flows.batch import batch_steps
from flows.batch.batch_steps import BatchTables
from flows.pipeline import run_gate
from flows.pipeline.baselines import NoBaseline
from flows.pipeline.run_gate import BatchJudgement
from specs.data.run_report import Verdict
from specs.errors import StoreAway
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate
from specs.untrusted_text import escape_markdown, table_rows
from tasks.progress.listener import artifact_key
from tasks.progress.task import STORE_RETRY, named_by, show_progress
from tasks.results.gate.evidence import Baseline
from tasks.results.gate.shipped_builds import Shipment
from tasks.simulate.audit.audit_report import AuditReport, AuditVerdict
from tasks.simulate.batch.batch_record import load_batch
from tasks.simulate.batch.chunk_run import ChunkEnd
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tasks.storage.store_url import open_store

_HEADINGS = ("episodes", "passed", "rate", "interval", "why not")
_VERDICT_MARKS: Mapping[Verdict, str] = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_AUDIT_MARKS: Mapping[AuditVerdict, str] = {"SOUND": "✅", "SUSPECT": "❌", "NOT COMPARED": "❔", "NOT RUN": "❔"}
# A page with more lines is read by nobody; the tables have them all.
_ROWS_SHOWN = 200


def chunk_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of a chunk, such as ``chunk 3 of 16``."""
    chunk = f"chunk {parameters['number'] + 1}"
    try:
        return f"{chunk} of {_chunks(parameters['store_url'], parameters['batch'])}"
    except StoreAway:  # Prefect asks before it runs the task, which would not be run again for it
        return chunk


@lru_cache(maxsize=8)
def _chunks(store_url: str, batch: str) -> int:
    return load_batch(open_store(store_url), batch).layout.chunks


@task(
    name="simulate-chunk",
    task_run_name=named_by(chunk_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def simulate_chunk(
    store_url: str,
    batch: str,
    number: int,
    *,
    location: OutputLocation,
    lanes: int,
    left_s: float,
    spent_s: float,
    done: int = 0,
    ahead: tuple[int, ...] = (),
    voucher: BatchAuthenticator | None = None,
) -> ChunkEnd:
    """Returns what `flows.batch.batch_steps.simulate_chunk` does."""
    return batch_steps.simulate_chunk(
        store_url,
        batch,
        number,
        location=location,
        lanes=lanes,
        left_s=left_s,
        spent_s=spent_s,
        done=done,
        ahead=ahead,
        voucher=voucher,
    )


@task(
    name="write-results",
    task_run_name="tables",
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def write_tables(store_url: str, batch: str, status: str, location: OutputLocation) -> BatchTables:
    """Returns what `flows.batch.batch_steps.write_tables` does, and shows the tables' summary."""
    tables = batch_steps.write_tables(store_url, batch, status, location)
    rows: list[dict[str, JsonValue]] = [dict(zip(_HEADINGS, row, strict=True)) for row in tables.rows[:_ROWS_SHOWN]]
    shown = table_rows(rows)
    said = f"Results of {batch}. {tables.note}."
    create_table_artifact(table=shown, key=artifact_key("batch-results"), description=said)
    return tables


@task(
    name="audit-batch",
    task_run_name="audit",
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def audit_batch(
    store_url: str, batch: str, location: OutputLocation, chunks: int | None = None
) -> dict[str, JsonValue]:
    """Returns what `flows.batch.batch_steps.audit_batch` does, and shows the audit's sentence."""
    with show_progress(batch_steps.AUDIT, "audit-progress"):
        detail = batch_steps.audit_batch(store_url, batch, location, chunks)
    report = AuditReport.model_validate(detail["audit"])
    said = escape_markdown(report.sentence)
    body = f"# {_AUDIT_MARKS[report.verdict]} {report.verdict}\n\n{said}\n\nReport: `{detail['audit_url']}`"
    create_markdown_artifact(body, key=artifact_key("parity-audit"))
    return detail


@task(
    name="judge",
    task_run_name="judge",
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def judge_batch(
    store_url: str,
    batch: str,
    rule: Gate,
    *,
    other: Baseline | NoBaseline | None,
    ships: Shipment | None,
    attempts: tuple[float, ...] = (),
) -> BatchJudgement:
    """Returns what `flows.pipeline.run_gate.judge_batch` does, and shows the verdict with the sentence of each rule."""
    judged = run_gate.judge_batch(store_url, batch, rule, other=other, ships=ships, attempts=attempts)
    verdict, mark = judged.verdict, _VERDICT_MARKS[judged.verdict.verdict]
    body = "\n".join(f"- {escape_markdown(f'{each.title}: {each.sentence}')}" for each in verdict.rules)
    create_markdown_artifact(
        f"# {mark} {verdict.verdict}\n\n{body}\n\nEvidence: `{judged.url}`", key=artifact_key("gate")
    )
    return judged
