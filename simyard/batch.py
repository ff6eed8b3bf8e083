"""What Python asks about a batch: `results`, `report`, `replay`, `compare`, `gate`. Each imports what it needs."""
# ruff: noqa: PLC0415 - see above

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simyard.answer.comparison import Comparison
    from simyard.answer.judgement import Judgement
    from simyard.answer.replay import Replay
    from simyard.answer.report import Report
    from simyard.answer.results import Results
    from simyard.answer.run import Run
    from simyard.document import DocumentLike
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
    from simyard.answer.results import Results
    from simyard.batch_table import batch_rows

    opened, named = _batch(batch, store)
    found, table = batch_rows(opened, named, columns, failures=failures)
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
    from flows.batch.report_files import write_report_page
    from simyard.answer.report import Report

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
    from simyard.answer.replay import Replay
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
    from flows.cli.batch.batch_text import comparison_answer, comparison_notes, warning
    from simyard.answer.comparison import Comparison
    from tasks.results.compare.comparison_verdict import comparison

    one, other = (find_batch(*_batch(each, store)) for each in (first, second))
    found = comparison(one.work.id, other.work.id, common_episodes(one, other), margin=margin, confidence=confidence)
    notes = (*comparison_notes(found), *filter(None, [warning(found)]))
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
    from flows.batch.judge_again import judge_again
    from simyard.answer.judgement import Judgement
    from simyard.document import validate

    opened, named = _batch(batch, store)
    return Judgement(judge_again(opened, named, validate(document, base=base)))


def _batch(batch: "str | Run", store: Place | None) -> "tuple[Store, str]":
    """Returns the store of a batch, and what names the batch there."""
    from simyard.answer.run import Run
    from simyard.store_place import store_url
    from specs.base import Fault
    from specs.errors import DocumentError
    from tasks.storage.store_url import open_existing_store

    if not isinstance(batch, Run):
        return open_existing_store(store_url(store)), batch
    if batch.batch is None:
        allowed = "a run of a document with a simulationBatch"
        raise DocumentError([Fault(path="run", value=batch.id, allowed=allowed)], batch.report.name)
    return open_existing_store(store_url(store) or batch.store), batch.batch
