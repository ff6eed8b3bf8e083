"""Result tables and the gate as Prefect tasks, with their artifacts."""

from collections.abc import Mapping
from typing import Any

from prefect import task
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE
from pydantic import JsonValue

from specs.common import OutputLocation
from specs.episode import EpisodeRequest, EpisodeResult
from specs.pipeline_simulation import SuccessRate
from specs.report import Verdict as Answer
from tasks.results.evidence import gather, write_evidence
from tasks.results.gate import Verdict, judge
from tasks.results.job import write_results
from tasks.results.summary import summarise, summary_rows, why_not
from tasks.storage.buckets import open_bucket
from tasks.storage.opening import open_store

_HEADINGS = ("episodes", "passed", "rate", "interval", "why not")
_MARKS: Mapping[Answer, str] = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}


@task(name="write-results", cache_policy=NO_CACHE, persist_result=False)
def write_tables(
    store_url: str,
    batch: str,
    requests: list[EpisodeRequest],
    results: list[EpisodeResult],
    *,
    location: OutputLocation,
    metadata: dict[str, str],
) -> dict[str, JsonValue]:
    """Returns where a batch's tables lie and what they add up to, for the batch's record."""
    bucket = open_bucket(open_store(store_url), location.s3Bucket or "")
    written = write_results(bucket, location.s3Prefix, batch, requests, results, metadata=metadata)
    rows: list[dict[str, Any]] = [
        dict(zip(_HEADINGS, row, strict=True)) for row in summary_rows(summarise(requests, results))
    ]
    create_table_artifact(table=rows, key="batch-results", description=f"Results of {batch}")
    passed = sum(result.status == "Completed" and result.outcome == "Passed" for result in results)
    simulated_s = round(sum(result.simulated_s for result in results), 3)
    groups: list[JsonValue] = [dict(row) for row in rows]
    reasons: list[JsonValue] = [
        {"reason": name, "episodes": count, "sample": sample} for name, count, sample in why_not(results)
    ]
    sums: dict[str, JsonValue] = {"episodes": len(results), "passed": passed, "simulated_s": simulated_s}
    return {**written, **sums, "groups": groups, "why_not": reasons}


@task(name="judge", cache_policy=NO_CACHE, persist_result=False)
def judge_batch(
    store_url: str,
    batch: str,
    requests: list[EpisodeRequest],
    results: list[EpisodeResult],
    *,
    rule: SuccessRate,
    worlds: dict[str, str],
    metadata: dict[str, str],
    files: dict[str, str],
) -> tuple[Verdict, str]:
    """Returns the gate's verdict and the URL of its evidence."""
    verdict = judge(results, rule, missing=len(requests) - len(results))
    engine = metadata["engine"]
    versions = {name: version for name, version in metadata.items() if name != "engine"}
    evidence = gather(batch, requests, rule, verdict, worlds=worlds, engine=engine, versions=versions, files=files)
    url = write_evidence(open_store(store_url), evidence)
    mark = _MARKS[verdict.verdict]
    create_markdown_artifact(f"# {mark} {verdict.verdict}\n\n{verdict.sentence}\n\nEvidence: `{url}`", key="gate")
    return verdict, url
