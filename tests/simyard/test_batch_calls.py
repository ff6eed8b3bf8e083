"""What Python asks about batches is what the commands show, as objects."""

import importlib.util
from collections.abc import Mapping
from pathlib import Path

import duckdb
import pytest

import simyard
from simyard.answer import batch_answers as results_module
from simyard.answer.run_answers import Run, Trend
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, ResourceNotFound
from tasks.results.trend.trend_series import Choice, make_trend
from tasks.results.trend.trend_view import trend_page, trend_view
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tests.factories.judged_batches import JOB, courier, delivery, ended
from tests.factories.planned_batches import begun, mixed
from tests.results.trend.histories import history


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store's folder."""
    return tmp_path_factory.mktemp("batch") / "store"


@pytest.fixture(scope="module")
def batch(folder: Path) -> JobRecord:
    """A batch of 80 episodes, some of which failed."""
    store, made = open_store(folder.as_uri()), folder.parent
    robot, scenario = courier(store, made, "one"), delivery(store, made)
    return ended(store, robot, scenario=scenario, simulate=mixed)


def run_with(stages: tuple[Mapping[str, object], ...], store: str) -> Run:
    report = {"run": "run-1", "name": "nightly", "stages": stages}
    return Run(PipelineReport.model_validate(report), store)


def test_the_rows_are_the_same_for_arrow_pandas_and_polars(batch: JobRecord, folder: Path):
    found = simyard.results(batch.arn, store=folder)
    passed = sum(found.table.column("success").to_pylist())
    assert len(found) == found.to_arrow().num_rows == 80
    assert found.to_pandas()["success"].tolist().count(True) == found.to_polars()["success"].sum() == passed
    assert repr(found) == f"<Results of {batch.id}: 80 episodes, {len(found.columns)} columns>"


def test_whatever_reads_arrow_reads_them_as_they_are(batch: JobRecord, folder: Path):
    found = simyard.results(batch.id, store=folder)
    with duckdb.connect() as connection:
        connection.register("episodes", found)
        assert connection.execute("select count(*) from episodes").fetchone() == (80,)


def test_a_run_knows_its_batch_and_its_store(batch: JobRecord, folder: Path):
    stage = {"name": "simulationBatch", "arn": batch.arn, "status": "Completed", "summary": "s", "seconds": 1.0}
    assert simyard.results(run_with((stage,), folder.as_uri())).batch == batch.id


def test_a_run_without_a_batch_has_no_results(folder: Path, batch: JobRecord):
    with pytest.raises(DocumentError, match="run-1: a run of a document with a simulationBatch"):
        simyard.results(run_with((), folder.as_uri()))


def test_columns_and_failures_may_be_chosen(batch: JobRecord, folder: Path):
    chosen = simyard.results(batch.id, store=folder, columns=["seed", "success"])
    assert chosen.columns == ("seed", "success")
    failed = simyard.results(batch.id, store=folder, failures=True)
    assert 0 < len(failed) < 80
    assert "failure_reason" in failed.columns


def test_a_column_that_is_none_is_told_with_those_that_are(batch: JobRecord, folder: Path):
    with pytest.raises(DocumentError, match=r"columns: speed: columns of results\.parquet: batch, job, index"):
        simyard.results(batch.id, store=folder, columns=["speed"])


def test_what_is_no_batch_is_told(batch: JobRecord, folder: Path):
    with pytest.raises(ResourceNotFound):
        simyard.results("simb-0123456789abcdef", store=folder)


def test_a_batch_that_has_not_ended_has_no_tables(folder: Path):
    store = open_store((folder.parent / "other").as_uri())
    with pytest.raises(DocumentError, match="a batch that has its tables; this one is"):
        simyard.results(begun(store).id, store=store.url)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_library_that_is_missing_is_told_with_the_command(
    batch: JobRecord, folder: Path, monkeypatch: pytest.MonkeyPatch, library: str
):
    real = importlib.util.find_spec
    monkeypatch.setattr(results_module, "find_spec", lambda name: None if name == library else real(name))
    found = simyard.results(batch.id, store=folder)
    with pytest.raises(DocumentError, match=rf"pip install 'simyard\[{library}\]'; without it, .table is an Arrow"):
        getattr(found, f"to_{library}")()


def test_a_notebook_shows_the_first_rows_and_how_many_there_are(batch: JobRecord, folder: Path):
    shown = simyard.results(batch.id, store=folder)._repr_html_()
    assert "80 episodes" in shown
    assert "and 56 more; to_pandas() has all" in shown
    assert "passed</span>" in shown
    assert "failed</span>" in shown


def test_a_report_is_written_and_shown_with_its_rates_and_where_it_is(batch: JobRecord, folder: Path, tmp_path: Path):
    report = simyard.report(batch.arn, store=folder, output=tmp_path / "page.html")
    shown = report._repr_html_()
    assert (tmp_path / "page.html").read_bytes() == report.page
    assert report.verdict is None
    assert "not judged" in repr(report)
    assert "By world" in shown
    assert f'href="{(tmp_path / "page.html").as_uri()}"' in shown


def test_a_batch_compared_with_itself_loses_nothing(batch: JobRecord, folder: Path):
    found = simyard.compare(batch.id, batch.arn, store=folder)
    assert found.found.pairs.flips == ()
    assert found.answer in repr(found)
    assert "0 gained and 0 lost of 80 pairs" in found._repr_html_()


def test_a_batch_is_judged_again_by_another_gate(batch: JobRecord, folder: Path):
    document = {
        "name": "later",
        "simulationBatch": {"matrix": {"worlds": ["g/w0"]}, "createSimulationJobRequests": [JOB]},
    }
    strict = simyard.gate(batch.id, {**document, "gate": {"successRate": {"atLeast": 0.99}}}, store=folder)
    lenient = simyard.gate(batch.arn, {**document, "gate": {"successRate": {"atLeast": 0.05}}}, store=folder)
    assert (strict.verdict, strict.passed) == ("FAIL", False)
    assert (lenient.verdict, lenient.passed) == ("PASS", True)
    assert repr(strict).startswith(f"<Judgement of {batch.arn}: ")
    assert "FAIL</span>" in strict._repr_html_()
    assert "a later judgement ships nothing" in strict._repr_html_()


def test_a_document_without_a_gate_judges_nothing(batch: JobRecord, folder: Path):
    document = {
        "name": "later",
        "simulationBatch": {"matrix": {"worlds": ["g/w0"]}, "createSimulationJobRequests": [JOB]},
    }
    with pytest.raises(DocumentError, match="gate"):
        simyard.gate(batch.id, document, store=folder)


def trend_of(nights: int, drop_at: int = 0, drop: float = 0.3) -> Trend:
    found = make_trend(history(nights, drop_at, drop), Choice())
    view = trend_view(found, document="<nightly>", words="passed", chosen="", first=0, base="", limit=365.0)
    return Trend(view, trend_page(view))


def test_a_notebook_shows_the_newest_nights_and_how_many_there_are():
    found = trend_of(40)
    assert repr(found) == f"<Trend of '<nightly>': passed, 40 nights, {len(found.alarms)} changes>"
    shown = found._repr_html_()
    assert found.nights[0].day in shown
    assert "and 16 more nights; .page has them" in shown
    assert "<nightly>" not in shown


def test_a_change_is_named_above_the_nights():
    found = trend_of(40, drop_at=20)
    assert found.alarms[0].fell
    assert "lower</span>" in found._repr_html_()
    assert found.alarms[0].bundle_name in found._repr_html_()


def test_the_name_is_offered():
    assert callable(simyard.trend)
