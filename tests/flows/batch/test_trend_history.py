"""The nights of a document are those that its runs left in the store, and nothing that somebody put in their place."""

import hashlib
import json
from pathlib import Path
from typing import cast
from urllib.parse import urlsplit

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from flows.batch import trend_history
from flows.batch.trend_history import TrendAsked, document_names, find_trend, read_history, write_trend_of_run
from specs.errors import DocumentError
from tasks.results.trend.trend_series import WHOLE, Measure, parse_measure
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.flows.batch.stored_nights import stored_night


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def changed_record(store: Store, batch: JobRecord, **changes: object) -> None:
    """Puts another record of a batch in the store, as whoever may write there can."""
    key = job_key(batch.kind, batch.id)
    whole = json.loads(store.get(key).body)
    store.put(key, json.dumps({**whole, **changes}).encode())


def results_file(batch: JobRecord) -> Path:
    return Path(urlsplit(str(batch.detail["results_url"])).path)


def counts(store: Store, **asked: bool) -> list[tuple[int, int]]:
    nights = read_history(store, "nightly", Measure(), **asked).nights
    return [(sum(c.successes for c in night.cells), sum(c.n for c in night.cells)) for night in nights]


def test_nights_are_the_runs_of_one_document_the_oldest_first(file_store: Store, tmp_path: Path):
    for number, failures in enumerate((2, 8)):
        stored_night(file_store, tmp_path, number, failures)
    stored_night(file_store, tmp_path, 0, document="weekly")
    assert counts(file_store) == [(78, 80), (72, 80)]
    assert document_names(file_store) == ["nightly", "weekly"]
    (first, second) = read_history(file_store, "nightly", Measure()).nights
    assert first.authentic
    assert first.variables == ("MAX_SPEED",)
    assert {cell.world for cell in first.cells} == {"g/w0", "g/w1"}
    assert first.bundles() != second.bundles()


def test_a_table_that_somebody_changed_is_left_out_with_the_reason(file_store: Store, tmp_path: Path):
    (_, one), (_, two) = (stored_night(file_store, tmp_path, number, 8 * number) for number in range(2))
    results_file(two).write_bytes(results_file(one).read_bytes())
    _, forged = read_history(file_store, "nightly", Measure()).nights
    assert forged.left_out == "its results.parquet is not what the batch wrote"
    assert forged.cells == ()


@pytest.mark.parametrize(
    "columns",
    [{}, {"world": [1]}, {"world": ["w"], "robot_digest": ["d"], "success": ["yes"], "environment": [[("a", "b")]]}],
)
def test_a_table_of_a_forged_record_that_is_none_spoils_no_other_night(
    file_store: Store, tmp_path: Path, columns: dict[str, list[object]]
):
    (_, one), _ = (stored_night(file_store, tmp_path, number) for number in range(2))
    pq.write_table(pa.table(columns), results_file(one))
    body = results_file(one).read_bytes()
    shas = {**cast("dict[str, str]", one.detail["sha256s"]), "results.parquet": hashlib.sha256(body).hexdigest()}
    changed_record(file_store, one, detail={**one.detail, "sha256s": shas})
    bad, good = read_history(file_store, "nightly", Measure()).nights
    assert bad.left_out == "its results.parquet is no table of a batch's results"
    assert sum(cell.n for cell in good.cells) == 80


def test_a_file_that_is_no_table_is_left_out(file_store: Store, tmp_path: Path):
    _, one = stored_night(file_store, tmp_path, 0)
    results_file(one).write_bytes(b"no table")
    shas = {"results.parquet": hashlib.sha256(b"no table").hexdigest()}
    changed_record(file_store, one, detail={**one.detail, "sha256s": shas})
    (bad,) = read_history(file_store, "nightly", Measure()).nights
    assert bad.left_out == "its results.parquet is no table of a batch's results"


@pytest.mark.parametrize("changes", [{"detail": {}}, {"request": {}}, {"request": {"plan": {"seeds": "none"}}}])
def test_a_record_that_lacks_what_a_batch_has_spoils_no_other_night(
    file_store: Store, tmp_path: Path, changes: dict[str, object]
):
    (_, one), _ = (stored_night(file_store, tmp_path, number) for number in range(2))
    changed_record(file_store, one, **changes)
    bad, good = read_history(file_store, "nightly", Measure()).nights
    assert bad.left_out == "its record is not one that a batch wrote"
    assert good.left_out == ""


def test_episodes_of_the_version_that_a_gate_compares_with_are_no_part_of_the_night(file_store: Store, tmp_path: Path):
    run, _ = stored_night(file_store, tmp_path, 0)
    (night,) = read_history(file_store, "nightly", Measure()).nights
    (digest,) = night.bundles()
    changed_record(file_store, run, detail={**run.detail, "baseline": {"digest": digest}})
    (night,) = read_history(file_store, "nightly", Measure(), anew=True).nights
    assert (night.robots, night.cells) == ((), ())


def test_a_night_without_rows_is_a_night_without_episodes(file_store: Store, tmp_path: Path):
    _, one = stored_night(file_store, tmp_path, 0)
    table = pq.read_table(results_file(one))
    pq.write_table(table.slice(0, 0), results_file(one))
    shas = {"results.parquet": hashlib.sha256(results_file(one).read_bytes()).hexdigest()}
    changed_record(file_store, one, detail={**one.detail, "sha256s": shas})
    (empty,) = read_history(file_store, "nightly", Measure()).nights
    assert (empty.left_out, empty.cells) == ("", ())


@pytest.mark.parametrize("damage", ["folder", "text"])
def test_a_cache_that_cannot_be_read_costs_time_alone(file_store: Store, tmp_path: Path, damage: str):
    stored_night(file_store, tmp_path, 0)
    before = counts(file_store)
    (kept,) = (tmp_path / "cache" / "trends").iterdir()
    kept.unlink()
    kept.mkdir() if damage == "folder" else kept.write_bytes(b'{"version": 1, "nights": {"a": 3}, \xff')
    assert counts(file_store) == before


def test_results_that_the_owners_key_does_not_vouch_for_are_marked(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    stored_night(file_store, tmp_path, 0)
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(tmp_path / "other-key"))
    (tmp_path / "other-key").write_bytes(b"k" * 32)
    view = find_trend(file_store, TrendAsked("nightly"))
    assert view.notice.startswith("1 night is not vouched for")
    assert view.rows[0].note == "not vouched for"


def test_a_batch_that_was_canceled_does_not_count(file_store: Store, tmp_path: Path):
    stored_night(file_store, tmp_path, 0)
    run = submit(
        file_store, "pipeline-run", {"flow": "pipeline", "spec": {"name": "nightly", "simulationBatch": {}}}, "x"
    )
    batch = submit(file_store, "simulation-job-batch", {}, stage_token(run, "batch"))
    advance(file_store, batch.kind, batch.id, "Canceled")
    nights = read_history(file_store, "nightly", Measure()).nights
    assert [night.left_out for night in nights] == ["", "its batch is Canceled"]


def test_the_second_time_no_table_is_read(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    _, batch = stored_night(file_store, tmp_path, 0)
    before = counts(file_store)
    monkeypatch.setattr(trend_history, "read_rows", None)
    assert counts(file_store) == before
    results_file(batch).unlink()
    assert counts(file_store) == before
    (night,) = read_history(file_store, "nightly", Measure(), anew=True).nights
    assert night.left_out == "its results.parquet is gone"


def test_a_night_that_drove_the_same_again_is_no_new_evidence(file_store: Store, tmp_path: Path):
    stored_night(file_store, tmp_path, 0)
    stored_night(file_store, tmp_path, 1, same_as=0)
    view = find_trend(file_store, TrendAsked("nightly"))
    assert [row.note for row in view.rows] == ["the same as before", ""]
    (bundle,) = view.bundles
    assert (bundle.nights, bundle.episodes) == (2, 80)


def test_a_fall_is_an_alarm_of_the_run_that_raised_it_and_its_page_lies_beside_the_batches(
    file_store: Store, tmp_path: Path
):
    for number in range(2):
        stored_night(file_store, tmp_path, number, 0)
    run, batch = stored_night(file_store, tmp_path, 2, 40)
    written = write_trend_of_run(file_store, run, batch)
    assert written
    page = Path(urlsplit(written.url).path)
    assert page == results_file(batch).parent.parent / "trends" / "nightly.html"
    alarm = written.alarms[0]
    assert (alarm.fell, alarm.seen, alarm.began, alarm.new_bundle) == (True, batch.arn, batch.arn, True)
    assert f"../{batch.id}/report.html" in page.read_text()
    earlier, _ = stored_night(file_store, tmp_path, 3, 40)
    assert write_trend_of_run(file_store, earlier, batch) == (written.url, ())


def test_a_fall_that_a_night_begun_later_ended_without_is_told_by_the_night_that_ended_last(
    file_store: Store, tmp_path: Path
):
    for number in range(2):
        stored_night(file_store, tmp_path, number, 0)
    slow, batch = stored_night(file_store, tmp_path, 2, 8)
    stored_night(file_store, tmp_path, 3, 8)
    written = write_trend_of_run(file_store, slow, batch)
    assert written
    assert [(alarm.series, alarm.fell) for alarm in written.alarms] == [(WHOLE, True)]
    late, late_batch = stored_night(file_store, tmp_path, 4, 8)
    assert write_trend_of_run(file_store, late, late_batch) == (written.url, ())


def test_a_trend_that_cannot_be_made_harms_no_run(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run, batch = stored_night(file_store, tmp_path, 0)
    monkeypatch.setattr(trend_history, "read_rows", None)
    assert write_trend_of_run(file_store, run, batch) is None


@pytest.mark.parametrize(("measure", "passed"), [("collision", 72), ("simulated_s:0.5", 80)])
def test_other_measures_are_counted(measure: str, passed: int, file_store: Store, tmp_path: Path):
    stored_night(file_store, tmp_path, 0, 8)
    view = find_trend(file_store, TrendAsked("nightly", parse_measure(measure)))
    assert view.rows[0].passed == passed


@pytest.mark.parametrize("measure", ["succes", "success:0.5", "simulated_s", "simulated_s:1.5", "nothing:0.5"])
def test_a_measure_that_is_none_is_refused(measure: str):
    with pytest.raises(DocumentError, match="--measure"):
        parse_measure(measure)


def test_a_document_that_is_not_there_is_refused_with_those_that_are(file_store: Store, tmp_path: Path):
    stored_night(file_store, tmp_path, 0)
    with pytest.raises(DocumentError, match="documents of this store with a batch: nightly"):
        find_trend(file_store, TrendAsked("nighty"))


def test_a_document_without_a_batch_is_none_that_a_trend_offers(file_store: Store, tmp_path: Path):
    stored_night(file_store, tmp_path, 0)
    submit(file_store, "pipeline-run", {"flow": "pipeline", "spec": {"name": "worlds", "worldGeneration": {}}}, "w")
    assert find_trend(file_store, TrendAsked()).document == "nightly"
    with pytest.raises(DocumentError, match=r"with a batch: nightly$"):
        find_trend(file_store, TrendAsked("worlds"))
