"""What Python asks about batches, such as `results`, `report`, `replay`, `search` and `suite`; and `trend` of nights.

Each imports what it needs when it is called.
"""
# ruff: noqa: PLC0415 - see above

import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    import pyarrow as pa
    from pydantic import JsonValue

    from simyard.answer.batch_answers import Comparison, Judgement, Replay, Report, Results, SearchAnswer
    from simyard.answer.run_answers import Run, Trend
    from simyard.document_calls import DocumentLike
    from specs.errors import DocumentError
    from tasks.storage.base.store import Store


Place = str | os.PathLike[str]


def results(
    batch: "str | Run", *, store: Place | None = None, columns: Sequence[str] | None = None, failures: bool = False
) -> "Results":
    """Returns a batch's episodes, a row each, as an Arrow table that pandas and Polars take.

    Args:
        batch: What `simyard.run` returned, or a batch's ARN or id.
        store: `file:///folder`, `s3://bucket/prefix` or a folder; a run's own, else SIMYARD_STORE, else `.simyard` in
            the working directory.
        columns: Names of columns; all, if left out.
        failures: Only those that did not pass, with the columns that these have besides.

    Raises:
        ResourceNotFound: There is no such batch, or its tables are gone.
        DocumentError: It has no tables yet, or no such column.
        StageFailed: Its tables are not what it wrote.
    """
    from simyard.answer.batch_answers import Results

    opened, named = _batch(batch, store)
    found, table = _batch_rows(opened, named, columns, failures=failures)
    return Results(found, table)


def report(batch: "str | Run", *, store: Place | None = None, output: Place | None = None) -> "Report":
    """Writes a batch's report, one HTML page that needs nothing but itself, and returns it.

    Args:
        batch: What `simyard.run` returned, or the ARN or id of a batch, of one of its jobs, or of a run.
        store: As for `results`.
        output: The file to write; `report.html` beside the batch's tables, if left out.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: It has no tables yet.
    """
    from flows.batch.batch_end import write_report_page
    from simyard.answer.batch_answers import Report

    opened, named = _batch(batch, store)
    page = write_report_page(opened, named, None if output is None else Path(output))
    return Report(page.url, page.page, page.view, page.notice)


def replay(job: "str | Run", index: int | None = None, *, store: Place | None = None) -> "Replay":
    """Simulates an episode once more, and returns it beside what was recorded of it.

    Args:
        job: A simulation job's ARN or `<batch>/<index>`; or a run or a batch, and which of its episodes.
        index: Which episode of a run or a batch, as the results' column `index` says.
        store: As for `results`.

    Raises:
        ResourceNotFound: There is no such job, or what it needs is gone.
        DocumentError: It names no job, or one that has not come to an end of its own.
    """
    from flows.batch.replay_episode import replay_job
    from simyard.answer.batch_answers import Replay
    from specs.arn import resource_name
    from tasks.simulate.devices import prepare_devices

    prepare_devices()
    opened, named = _batch(job, store)
    return Replay(replay_job(opened, named if index is None else f"{resource_name(named)}/{index}"))


def compare(
    first: "str | Run",
    second: "str | Run",
    *,
    margin: float = 0.02,
    confidence: float = 0.95,
    store: Place | None = None,
) -> "Comparison":
    """Compares two batches of one store over the episodes that both have.

    Args:
        first: As for `results`.
        second: The one that must be no worse.
        margin: How much lower its success rate may be, 0 to 1.
        confidence: Of the interval.
        store: As for `results`.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: They have no episodes in common.
    """
    from flows.batch.compare_batches import common_episodes, find_batch
    from simyard.answer.batch_answers import Comparison
    from tasks.results.batch_comparison import comparison, comparison_answer, comparison_notes, comparison_warning

    one, other = (find_batch(*_batch(each, store)) for each in (first, second))
    found = comparison(one.work.id, other.work.id, common_episodes(one, other), margin=margin, confidence=confidence)
    notes = (*comparison_notes(found), *filter(None, [comparison_warning(found)]))
    return Comparison(found, comparison_answer(found), notes)


def gate(
    batch: "str | Run",
    document: "DocumentLike",
    *,
    base: Place | None = None,
    store: Place | None = None,
) -> "Judgement":
    """Judges a batch that has ended by a document's gate, without simulating; nothing is shipped by it.

    Args:
        batch: As for `results`.
        document: As for `simyard.run`; only its section `gate` is asked.
        base: Folder that the document's relative paths start from.
        store: As for `results`.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: The batch has no tables yet, or the document has no gate, or names what the batch has not.
    """
    from flows.pipeline.judge_again import judge_again
    from simyard.answer.batch_answers import Judgement
    from simyard.document_calls import validate

    opened, named = _batch(batch, store)
    return Judgement(judge_again(opened, named, validate(document, base=base)))


def _batch(batch: "str | Run", store: Place | None) -> "tuple[Store, str]":
    """Returns the store of a batch, and what names the batch there."""
    from simyard.answer.run_answers import Run
    from simyard.document_calls import store_url
    from specs.errors import DocumentError
    from tasks.storage.store_url import open_existing_store

    if not isinstance(batch, Run):
        return open_existing_store(store_url(store)), batch
    if batch.batch is None:
        allowed = "a run of a document with a simulationBatch"
        raise DocumentError.of("run", batch.id, allowed, source=batch.report.name)
    return open_existing_store(store_url(store) or batch.store), batch.batch


def search(
    batch: "str | Run",
    over: Mapping[str, "Mapping[str, JsonValue]"],
    *,
    measure: str = "min_clearance_m",
    against: str | None = None,
    episodes: int = 20_000,
    distinct: int = 20,
    explore: int = 0,
    confidence: float = 0.95,
    relative_error: float | None = None,
    seed: int = 0,
    store: Place | None = None,
) -> "SearchAnswer":
    """Finds rare failures of a batch's robot, and returns how probable a failure is; simulates thousands of episodes.

    What was simulated is in the store: a search that was killed goes on where it was.

    Args:
        batch: As for `results`; with one request.
        over: Its environment variables that vary, each with `uniform` or `logUniform` bounds, a `normal` distribution
            or a `choice`.
        measure: A column of the results that is near 0 close to a failure, and below it in one.
        against: Number of another version of the robot application: a failure is an episode in which that one passes.
        episodes: How many may be simulated, 1,000 to 1,000,000; those that failed are driven by the other version, too.
        distinct: How many failures are reported, at most 100; each is simulated twice more, once on C MuJoCo.
        explore: How many more episodes are simulated near failures that were met, to meet others.
        confidence: Of the interval.
        relative_error: The search ends once the interval reaches so far from the probability, as a share of it, 0.01 to
            1; left out, it spends its episodes.
        seed: Everything that is drawn follows from it.
        store: As for `results`.

    Raises:
        ResourceNotFound: There is no such batch, or what it needs is gone.
        DocumentError: The settings are wrong, or the batch does not have the variables; with all faults.
        StageFailed: An episode did not come to an end of its own.
    """
    from flows.batch.search_batch import search_batch
    from simyard.answer.batch_answers import SearchAnswer
    from specs.pipeline.search_section import Search
    from tasks.documents.parse import parse
    from tasks.simulate.devices import prepare_devices
    from tasks.storage.resource_names import find_batch_name

    opened, named = _batch(batch, store)
    settings: dict[str, JsonValue] = {
        "over": {name: {**each} for name, each in over.items()},
        "measure": measure,
        **({} if against is None else {"against": against}),
        "find": {"distinct": distinct, "episodes": explore},
        "budget": {"episodes": episodes},
        "estimate": {"confidence": confidence, **({} if relative_error is None else {"relativeError": relative_error})},
        "seed": seed,
    }
    asked = parse(Search, settings, "search")
    prepare_devices()
    return SearchAnswer(search_batch(opened.url, find_batch_name(opened, named), asked))


def suite(batch: "str | Run", *, output: Place | None = None, store: Place | None = None) -> "dict[str, JsonValue]":
    """Returns a document whose batch drives the failures again that the search of a batch's document has found.

    `simyard.run` takes it.

    Args:
        batch: As for `results`.
        output: A file to write it to, too, as YAML.
        store: As for `results`.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: Its document has searched for nothing, or no failure was confirmed.
    """
    from flows.batch.suite import regression_suite

    opened, named = _batch(batch, store)
    found = regression_suite(opened, named)
    if output is not None:
        Path(output).write_text(found.text(), encoding="utf-8")
    return found.document


def trend(
    document: str = "",
    *,
    measure: str = "success",
    world: str = "",
    version: str = "",
    variables: Mapping[str, str] | None = None,
    since: datetime | None = None,
    last: int = 0,
    store: str | os.PathLike[str] | None = None,
) -> "Trend":
    """Returns a document's rates night by night, and where they changed.

    Args:
        document: Its name; left out, the store's only one.
        measure: `success`, `collision`, or a column and a quantile, such as `simulated_s:0.95`.
        world: Only episodes in this world.
        version: Only episodes of this version, or of the bundle with this digest.
        variables: Only episodes with these values.
        since: The first time to show.
        last: How many nights to show; 0 for all.
        store: `file:///folder`, `s3://bucket/prefix` or a folder; SIMYARD_STORE, else `.simyard` in the working
            directory.

    Raises:
        DocumentError: There is no such document, or measure.
    """
    from flows.batch.trend_history import TrendAsked, find_trend
    from simyard.answer.run_answers import Trend
    from simyard.document_calls import store_url
    from tasks.results.trend.trend_series import Choice, parse_measure
    from tasks.results.trend.trend_view import trend_page
    from tasks.storage.store_url import open_existing_store

    choice = Choice(world, version, tuple((variables or {}).items()))
    since_s = since.timestamp() if since else 0.0
    asked = TrendAsked(document=document, measure=parse_measure(measure), choice=choice, last=last, since_s=since_s)
    view = find_trend(open_existing_store(store_url(store)), asked)
    return Trend(view, trend_page(view))


def _batch_rows(store: "Store", batch: str, columns: Sequence[str] | None, *, failures: bool) -> "tuple[str, pa.Table]":
    """Returns a batch's id and its rows.

    Args:
        store: The store of the batch.
        batch: ARN or id of the batch, of one of its jobs, or of a run of a document.
        columns: Names of columns; None for all.
        failures: Whether to read the table of those that did not pass.

    Raises:
        ResourceNotFound: There is no such batch, or its tables are gone.
        DocumentError: It has no tables yet, or no such column.
        StageFailed: They are not what it wrote.
    """
    from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE, stored_rows
    from tasks.simulate.batch.batch_record import KIND, load_batch
    from tasks.simulate.plan.plan_batch import recorded_location
    from tasks.storage.resource_names import find_batch_name

    record = load_batch(store, find_batch_name(store, batch)).record()
    if "results_url" not in record.detail:
        raise _refused(KIND, record.id, f"a batch that has its tables; this one is {record.status}")
    name = FAILURES_FILE if failures else RESULTS_FILE
    written = cast("dict[str, str]", record.detail["sha256s"])[name]
    table = stored_rows(store, recorded_location(record), record.id, name, sha256=written)
    unknown = [each for each in columns or () if each not in table.column_names]
    if unknown:
        raise _refused("columns", ", ".join(unknown), f"columns of {name}: {', '.join(table.column_names)}")
    return record.id, table.select(list(columns)) if columns else table


def _refused(path: str, value: str, allowed: str) -> "DocumentError":
    from specs.errors import DocumentError

    return DocumentError.of(path, value, allowed, source="simyard")
