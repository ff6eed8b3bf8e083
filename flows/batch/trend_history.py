"""A document's trend: its nights in the store, what is shown of them, its page, and the alarms that a run has raised.

A night is a run, its batch, and what the batch's tables hold. Thousands of objects are read, a few at a time. What an
ended run came to never changes, so that it is kept in the cache folder, where none but the owner writes; there a
thousand nights are one small file.
"""

import hashlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np
import pyarrow as pa
from jaxtyping import Float
from pydantic import Field, JsonValue, ValidationError

from specs.base import Spec, canonical_json, digest
from specs.errors import BucketNotFound, DocumentError, ObjectNotFound, ResourceNotFound, SimyardError
from specs.field_types import OutputLocation
from tasks.results.report.report_page import REPORT_FILE, file_key
from tasks.results.statistics.change_point import NIGHTS_A_YEAR
from tasks.results.tables.history_rows import HistoryRows, count_cells, join_rows, read_rows
from tasks.results.tables.result_files import RESULTS_FILE
from tasks.results.trend.trend_series import (
    Choice,
    Measure,
    Night,
    Trend,
    is_good,
    make_trend,
    raised_alarms,
    usual_value,
)
from tasks.results.trend.trend_view import Alarm, TrendView, alarm_of, trend_page, trend_view
from tasks.simulate.batch.batch_record import KIND, plan_of
from tasks.simulate.batch.provenance import is_sealed
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import JOB, jobs_prefix, key_pattern, output_key, trend_key
from tasks.storage.base.local_files import cache_folder, whole_file
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.authenticator import has_owner_key, owner_authenticator
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import document_of_run, jobs_of
from tasks.storage.store_url import store_id

logger = logging.getLogger(__name__)


class KeptNights(Spec):
    """What is known without reading the store.

    Attributes:
        version: Of what a night says; what another version kept is read again.
        documents: Name of the document that each ended run is of, by the run's id.
        nights: Nights of ended runs, by the run's id; None for a run that is no night.
    """

    version: Literal[2] = 2
    documents: dict[str, str] = Field(default_factory=dict[str, str])
    nights: dict[str, Night | None] = Field(default_factory=dict[str, Night | None])


def kept_nights(store: Store, document: str) -> KeptNights:
    """Returns what was kept of a document's nights; nothing if there is no such file, or another version's."""
    path = _cache_file(store, document)
    try:
        return KeptNights.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return KeptNights()
    except OSError as exc:
        logger.warning("%s cannot be read, so that all tables are read again: %s", path, exc)
        return KeptNights()


def keep_nights(store: Store, document: str, kept: KeptNights) -> None:
    """Keeps nights for the next time; a folder that cannot be written costs time and nothing else."""
    path = _cache_file(store, document)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with whole_file(path, 0o600) as file:
            file.write(kept.model_dump_json().encode())
    except OSError as exc:
        logger.warning("%s cannot be written, so that the next trend takes longer: %s", path, exc)


def _cache_file(store: Store, document: str) -> Path:
    name = hashlib.sha256(f"{store.url} {store_id(store)} {document}".encode()).hexdigest()[:16]
    return cache_folder() / "trends" / f"{name}.json"


MOST_NIGHTS = 1_000
_THREADS = 8
_AT_ONCE = 64
_RUNS = "pipeline-run"


class History(NamedTuple):
    """A document's nights, the oldest first, and the value that a quantile is compared with."""

    nights: list[Night]
    at_most: float | None = None


class _Read(NamedTuple):
    """A night as the store has it: its facts, its rows, the bundle that is no part of it, and whether all has ended."""

    night: Night
    rows: pa.Table | None
    compared_with: str
    ended: bool


def document_names(store: Store) -> list[str]:
    """Returns the names of the documents that have a batch and runs in a store, sorted."""
    with ThreadPoolExecutor(_THREADS) as pool:
        runs = pool.map(partial(_run, store), _run_ids(store))
        return sorted({document_of_run(run) for run in runs if run and _has_batch(run)})


def _has_batch(run: JobRecord) -> bool:
    spec = run.request.get("spec")
    return run.request.get("flow") == "pipeline" and isinstance(spec, dict) and bool(spec.get("simulationBatch"))


def read_history(store: Store, document: str, measure: Measure, *, anew: bool = False) -> History:
    """Returns the nights of a document, the newest thousand at most.

    Args:
        store: Where its runs are.
        document: Its name.
        measure: What is counted.
        anew: Whether to read everything from the store, whatever is kept in the cache folder.

    Raises:
        StoreError: The store cannot be read.
    """
    kept = KeptNights() if anew or measure != Measure() else kept_nights(store, document)
    ids = _run_ids(store)
    with ThreadPoolExecutor(_THREADS) as pool:
        others = [each for each in ids if kept.documents.get(each, document) == document and not _is_kept(kept, each)]
        runs = [run for run in pool.map(partial(_run, store), others) if run]
        ours = [run for run in runs if run.request.get("flow") == "pipeline" and document_of_run(run) == document]
        newest = sorted(ours, key=lambda run: run.created_at_s)[-MOST_NIGHTS:]
        found = pool.map(partial(_read_night, store, measure, _buckets(store)), newest)
        counted, at_most = _counted(zip(newest, found, strict=True), measure)
    ended = {run.id: document_of_run(run) for run in runs if is_terminal(run)}
    nights = {run.id: night for run, night, over in counted if over}
    now = KeptNights(documents={**kept.documents, **ended}, nights={**kept.nights, **nights})
    if measure == Measure() and (ended or nights):
        keep_nights(store, document, now)
    there = set(ids)
    old = [night for run, night in now.nights.items() if night and run in there]
    fresh = [night for _, night, over in counted if night and not over]
    return History(sorted([*old, *fresh], key=lambda night: (night.begun_at_s, night.run))[-MOST_NIGHTS:], at_most)


def _is_kept(kept: KeptNights, run: str) -> bool:
    """Returns whether a night need not be read: another key may vouch by now for one that was not vouched for."""
    night = kept.nights.get(run)
    return run in kept.nights and (night is None or night.authentic or bool(night.left_out) or not has_owner_key())


def _run_ids(store: Store) -> list[str]:
    form = key_pattern(JOB, kind=_RUNS)
    matches = (form.fullmatch(key) for key in store.keys(jobs_prefix(_RUNS)))
    return [found["job"] for found in matches if found]


def _run(store: Store, run: str) -> JobRecord | None:
    try:
        return read(store, _RUNS, run)
    except ResourceNotFound:  # removed since it was listed
        return None


def _buckets(store: Store) -> Callable[[str], Store]:
    """Returns what opens each bucket once."""

    @cache
    def opened(name: str) -> Store:
        return open_bucket(store, name)

    return opened


def _counted(
    found: Iterator[tuple[JobRecord, _Read | None]], measure: Measure
) -> tuple[list[tuple[JobRecord, Night | None, bool]], float | None]:
    """Returns each run's night with its cells, and whether all has ended; a quantile needs all at a time."""
    done: list[tuple[JobRecord, Night | None, bool]] = []
    at_most: float | None = None
    while some := list(islice(found, None if measure.quantile else _AT_ONCE)):
        with_rows = [each for _, each in some if each and each.rows is not None]
        names = sorted({name for each in with_rows for name in each.night.variables})
        cells: dict[str, Night] = {}
        if with_rows:
            rows = join_rows([cast("pa.Table", each.rows) for each in with_rows], measure.column, names)
            if measure.quantile:
                at_most = usual_value(_by_batch(rows, len(with_rows)), measure.quantile)
            cells = _with_cells(with_rows, rows, names, at_most)
        for run, each in some:
            night = cells.get(each.night.run, each.night) if each else None
            done.append((run, night, is_terminal(run) and (each is None or each.ended)))
    return done, at_most


def _by_batch(rows: HistoryRows, batches: int) -> list[Float[np.ndarray, " rows"]]:
    ends = np.searchsorted(rows.batch, np.arange(1, batches))
    return np.split(rows.value, ends)


def _with_cells(
    found: Sequence[_Read], rows: HistoryRows, names: Sequence[str], at_most: float | None
) -> dict[str, Night]:
    """Returns nights with their cells, by run; those of the version that a gate compared with are left out."""
    counted: dict[str, Night] = {}
    for each, cells in zip(found, count_cells(rows, is_good(rows.value, at_most), len(found)), strict=True):
        own = [names.index(name) for name in each.night.variables]
        kept = tuple(
            cell._replace(variables=tuple(cell.variables[at] for at in own))
            for cell in cells
            if cell.bundle != each.compared_with
        )
        counted[each.night.run] = each.night.model_copy(update={"cells": kept})
    return counted


def _read_night(store: Store, measure: Measure, bucket: Callable[[str], Store], run: JobRecord) -> _Read | None:
    """Returns a run's night, or None if there is none or none yet."""
    batch = next((job for kind, job in jobs_of(run) if kind == KIND), None)
    if batch is None:
        return None
    try:
        record = read(store, KIND, batch)
    except ResourceNotFound:
        why = "the run ended before its batch" if is_terminal(run) else ""
        return _Read(_facts(run, None).model_copy(update={"left_out": why}), None, "", ended=True) if why else None
    if not is_terminal(record):
        return None
    night = _facts(run, record)
    if record.status != "Completed":
        return _Read(night.model_copy(update={"left_out": f"its batch is {record.status}"}), None, "", ended=True)
    return _read_rows(record, night, measure, bucket, _compared_with(run))


def _read_rows(
    record: JobRecord, night: Night, measure: Measure, bucket: Callable[[str], Store], compared_with: str
) -> _Read:
    try:
        place, plan = recorded_location(record), plan_of(record)
        sha256 = cast("Mapping[str, str]", record.detail["sha256s"])[RESULTS_FILE]
    except (KeyError, TypeError, ValueError):  # whoever may write to the store may have written anything
        return _left_out(night, "its record is not one that a batch wrote")
    several = tuple(name for name, values in plan.variables().items() if len(values) > 1)
    robots = {each.robot.digest: each.robot for each in plan.templates if each.robot.digest != compared_with}
    facts = {
        "robots": tuple(robots.values()),
        "variables": several,
        "authentic": has_owner_key() and is_sealed(record, owner_authenticator(record.id, digest(plan))),
        "early": "stopped_early" in record.detail,
    }
    night = night.model_copy(update=facts)
    try:
        opened = bucket(place.s3Bucket or "")
        body = opened.get(file_key(place, record.id, RESULTS_FILE)).body
    except (ObjectNotFound, BucketNotFound):
        return _left_out(night, f"its {RESULTS_FILE} is gone")
    night = night.model_copy(update={"page": f"{opened.url}/{file_key(place, record.id, REPORT_FILE)}"})
    if hashlib.sha256(body).hexdigest() != sha256:
        return _left_out(night, f"its {RESULTS_FILE} is not what the batch wrote")
    try:
        rows = read_rows(body, measure.column, variables=bool(several))
    except ValueError:
        return _left_out(night, f"its {RESULTS_FILE} is no table of a batch's results")
    return _Read(night, rows, compared_with, ended=True)


def _left_out(night: Night, why: str) -> _Read:
    """Returns a night that does not count now, and may do so later: a file may be put back."""
    return _Read(night.model_copy(update={"left_out": why}), None, "", ended=False)


def _facts(run: JobRecord, record: JobRecord | None) -> Night:
    spec = cast("Mapping[str, JsonValue]", run.request["spec"])
    found = cast("Mapping[str, JsonValue]", run.request.get("pins") or {})
    imported = {"imported": found["worlds"]} if "worlds" in found else {}
    made = canonical_json({"worlds": spec.get("worldGeneration"), "template": found.get("template"), **imported})
    gate = spec.get("gate")
    early = gate if isinstance(gate, dict) and gate.get("stopEarly") else None
    # What a document ships decides nothing of what its batch drives.
    drives = {"batch": spec.get("simulationBatch"), "pins": found.get("batch"), "gate": early, "made": made.decode()}
    generations = [job for kind, job in jobs_of(run) if kind == "world-generation-job"]
    return Night(
        run=run.id,
        request=hashlib.sha256(canonical_json(drives)).hexdigest(),
        worlds_made=hashlib.sha256(made).hexdigest()[:16],
        generation=generations[0] if generations else "",
        more_generations=tuple(generations[1:]),
        batch=record.id if record else "",
        arn=record.arn if record else run.arn,
        begun_at_s=record.created_at_s if record else run.created_at_s,
    )


def _compared_with(run: JobRecord) -> str:
    """Returns the digest of the bundle that the run's gate compares with; its episodes are no part of the trend."""
    found = run.detail.get("baseline")
    return str(found.get("digest", "")) if isinstance(found, dict) else ""


class TrendAsked(NamedTuple):
    """What is asked for.

    Attributes:
        document: The document's name; empty for the only one.
        measure: What is counted of each episode.
        choice: Which episodes are looked at.
        last: How many nights are shown; 0 for all.
        since_s: The first time that is shown, seconds since 1970.
        anew: Whether nothing is taken from the cache folder.
    """

    document: str = ""
    measure: Measure = Measure()
    choice: Choice = Choice()
    last: int = 0
    since_s: float = 0.0
    anew: bool = False


class WrittenTrend(NamedTuple):
    """A page that was written, and the alarms that were first seen at the end of the run's batch."""

    url: str
    alarms: tuple[Alarm, ...]


def find_trend(store: Store, asked: TrendAsked, *, base: str = "") -> TrendView:
    """Returns what is shown of a document's nights.

    Args:
        store: Where its runs are.
        asked: What is asked for.
        base: URL of the folder that the page's relative links start from; empty if all links are whole.

    Raises:
        DocumentError: There is no such document, or no such episode.
    """
    document = asked.document or _only_document(store)
    history = read_history(store, document, asked.measure, anew=asked.anew)
    if not history.nights:
        names = document_names(store)
        allowed = "the name of a document with a batch that has ended"
        if document not in names:
            allowed += (
                f"; documents of this store with a batch: {', '.join(names[:20])}" if names else "; this store has none"
            )
        raise DocumentError.of("DOCUMENT-NAME", repr(document), allowed, source="simyard")
    return _view(make_trend(history.nights, asked.choice), history, asked._replace(document=document), base)


def write_trend_of_run(store: Store, run: JobRecord, batch: JobRecord) -> WrittenTrend | None:
    """Writes the trend of a run's document; returns where, and the alarms that this run's batch has raised.

    A trend decides nothing: if it cannot be made, the log says why, and None is returned.

    Args:
        store: Where the run is.
        run: The run of a document.
        batch: Its batch, which has ended.
    """
    try:
        return _write(store, document_of_run(run), run.id, recorded_location(batch))
    except SimyardError as exc:
        logger.warning("no trend was written: %s", exc)
    except Exception:
        logger.exception("no trend was written: this is a defect of Simyard")
    return None


def _write(store: Store, document: str, run: str, place: OutputLocation) -> WrittenTrend:
    bucket = open_bucket(store, place.s3Bucket or "")
    key = output_key(place.s3Prefix, trend_key(document))
    base = f"{bucket.url}/{key}".removesuffix(f"/{trend_key(document)}")
    asked = TrendAsked(document)
    history = read_history(store, document, asked.measure)
    trend = make_trend(history.nights, asked.choice)
    bucket.put(key, trend_page(_view(trend, history, asked, base)))
    raised = raised_alarms(trend, asked.choice, run)
    return WrittenTrend(f"{bucket.url}/{key}", tuple(alarm_of(trend, each, change) for each, change in raised))


def _view(trend: Trend, history: History, asked: TrendAsked, base: str) -> TrendView:
    shown = [at for at, night in enumerate(trend.nights) if night.begun_at_s >= asked.since_s]
    if not shown:
        day = datetime.fromtimestamp(asked.since_s, tz=UTC).date().isoformat()
        raise DocumentError.of("--since", day, "a day with a night on it or after it")
    first = max(shown[0], len(trend.nights) - asked.last if asked.last else 0)
    choice = asked.choice
    parts = [
        f"world {choice.world}" if choice.world else "",
        f"version {choice.version}" if choice.version else "",
        *(f"{name} = {value}" for name, value in choice.variables),
    ]
    return trend_view(
        trend,
        document=asked.document,
        words=asked.measure.words(history.at_most),
        chosen=", ".join(filter(None, parts)),
        first=first,
        base=base,
        limit=NIGHTS_A_YEAR,
    )


def _only_document(store: Store) -> str:
    names = document_names(store)
    if len(names) == 1:
        return names[0]
    allowed = f"one of {', '.join(names[:20])}" if names else "a document whose batch was run in this store"
    raise DocumentError.of("DOCUMENT-NAME", "not given", allowed, source="simyard")
