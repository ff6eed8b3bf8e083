"""Result tables and the gate as Prefect tasks, with their artifacts."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from prefect import task
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE
from pydantic import JsonValue

from specs.artifact_text import escape_markdown, table_rows
from specs.data.run_report import Verdict
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate
from tasks.results.gate.evidence import Baseline, TestedBatch, evidence_digest, gather, write_evidence
from tasks.results.gate.gate import GateVerdict, judge
from tasks.results.gate.rules.rule import GateMaterial
from tasks.results.gate.shipped_builds import Shipment
from tasks.results.statistics.summary import summary_rows
from tasks.results.tables.result_files import EpisodePart, Variables
from tasks.results.tables.table_record import write_batch_tables
from tasks.storage.store_url import open_store

_HEADINGS = ("episodes", "passed", "rate", "interval", "why not")
_MARKS: Mapping[Verdict, str] = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
# A page with more lines is read by nobody; the tables have them all.
_ROWS_SHOWN = 200


@task(name="write-results", cache_policy=NO_CACHE, persist_result=False)
def write_tables(
    store_url: str,
    batch: str,
    parts: Callable[[], Iterable[EpisodePart]],
    *,
    variables: Variables,
    location: OutputLocation,
    metadata: dict[str, str],
) -> dict[str, JsonValue]:
    """Returns where a batch's tables lie and what they add up to, for the batch's record.

    Args:
        store_url: The store that the output location's bucket belongs to.
        batch: The batch's id.
        parts: Gives its episodes in the order of their indices, some at a time.
        variables: The values that each environment variable takes in the batch.
        location: Where the tables go.
        metadata: For the files' footers, which get the engines and devices of the rows besides.
    """
    detail, tally = write_batch_tables(
        open_store(store_url), batch, parts(), variables=variables, location=location, metadata=metadata
    )
    rows: list[dict[str, Any]] = [
        dict(zip(_HEADINGS, row, strict=True)) for row in summary_rows(tally.summary())[:_ROWS_SHOWN]
    ]
    shown = table_rows(rows)
    create_table_artifact(table=shown, key="batch-results", description=f"Results of {batch}")
    return detail


@task(name="judge", cache_policy=NO_CACHE, persist_result=False)
def judge_batch(
    store_url: str,
    batch: str,
    *,
    rule: Gate,
    material: Callable[[], GateMaterial],
    tested: TestedBatch,
    baseline: Baseline | None = None,
    ships: Shipment | None = None,
) -> tuple[GateVerdict, str, str]:
    """Returns the gate's verdict, and the URL and the SHA-256 of its evidence.

    Args:
        store_url: Where evidence is kept.
        batch: The batch's id.
        rule: What the document asks for.
        material: Gives what the gate judges by; Prefect would look into the rows themselves.
        tested: What was tested, and with what.
        baseline: The version that ``noWorseThan`` compares with.
        ships: What the document ships, if it deploys.
    """
    found = material()
    verdict = judge(rule, found)
    left_out = found.lacks.left_out
    evidence = gather(batch, rule, verdict, tested, left_out=left_out, baseline=baseline, ships=ships)
    url = write_evidence(open_store(store_url), evidence)
    mark, body = (
        _MARKS[verdict.verdict],
        "\n".join(f"- {escape_markdown(f'{each.title}: {each.sentence}')}" for each in verdict.rules),
    )
    create_markdown_artifact(f"# {mark} {verdict.verdict}\n\n{body}\n\nEvidence: `{url}`", key="gate")
    return verdict, url, evidence_digest(evidence)
