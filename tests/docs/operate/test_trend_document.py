"""docs/guide/trend.md: its commands, options, limits and events are the program's."""

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.results.trend import (
    CORRELATIONS,
    DESIGNS,
    NIGHTS,
    PAGE,
    RATES,
    Setting,
    false_alarms,
    seen_by_factors,
)
from flows.batch.trend_history import MOST_NIGHTS
from flows.cli.shell import app, load
from flows.prefect import prefect_events
from tasks.results.statistics.change_point import NIGHTS_A_YEAR
from tasks.results.trend.trend_series import MOST_SERIES, WHOLE
from tasks.results.trend.trend_view import MOST_ROWS, trend_page
from tasks.storage.base.store import Store
from tests.flows.batch.stored_nights import stored_night
from tests.results.trend.histories import history
from tests.results.trend.test_trend_view import view

DOCUMENT = PAGE.read_text()
TEXT = " ".join(DOCUMENT.split())
(BLOCK,) = re.findall(r"```sh\n(.*?)```", DOCUMENT, re.DOTALL)


@pytest.fixture
def nights(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    """A store with three nights of the document that the page names; the last one fell."""
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("SIMYARD_STORE", file_store.url)
    monkeypatch.chdir(tmp_path)
    for number, failures in enumerate((0, 0, 40)):
        stored_night(file_store, tmp_path, number, failures, document="apartment-regression")
    return file_store


def test_its_commands_run_and_tell_of_a_fall(nights: Store, tmp_path: Path):
    for line in BLOCK.splitlines():
        program, *arguments = shlex.split(line)
        done = CliRunner().invoke(app, arguments, catch_exceptions=False)
        assert (program, done.exit_code) == (".venv/bin/simyard", 0), done.output
    assert (tmp_path / ".simyard" / "trend.html").stat().st_size > 10_000
    told = CliRunner().invoke(app, ["trend"]).output
    assert f"{WHOLE}: the rate fell from 100.0 to 50.0 %" in told
    assert "the first night of that bundle" in told


def test_every_option_is_told():
    command = load("trend")
    options = {name for parameter in command.params for name in parameter.opts if name.startswith("--")}
    assert {name for name in options if f"`{name}" not in TEXT} <= {"--store", "--help"}


def test_every_section_of_the_page_is_told():
    headings = re.findall(r"<h2 id=[^>]*>(.*?)</h2>", trend_page(view(history(20))).decode())
    known = {"By world": "By world, by variable", "By MAX_SPEED": "By world, by variable"}
    assert [each for each in headings if f"| {known.get(each, each)} |" not in DOCUMENT] == []


def test_its_limits_are_those_of_the_code():
    assert f"At most {MOST_SERIES} of them." in TEXT
    assert f"The last {MOST_ROWS} nights" in TEXT
    assert f"Of more nights than {MOST_NIGHTS:,}, the newest count." in TEXT
    assert f"less than one false alarm in {NIGHTS_A_YEAR} nights" in TEXT
    assert f"Simulated histories of {NIGHTS} nights" in TEXT


def test_what_it_links_to_is_there():
    links = re.findall(r"\]\(([^)#]+)(?:#\w+)?\)", DOCUMENT)
    assert [link for link in links if not (PAGE.parent / link).exists()] == []


def test_its_facts_of_an_event_are_those_that_are_sent(monkeypatch: pytest.MonkeyPatch):
    sent: list[tuple[str, dict[str, str]]] = []
    monkeypatch.setattr(
        prefect_events, "emit_event", lambda event, _resource, payload, **_: sent.append((event, payload))
    )
    alarm = next(each for each in view(history(60, drop_at=45)).alarms if each.series == WHOLE)
    prefect_events.announce_alarm(alarm, "file:///trend.html")
    prefect_events.announce_alarm(alarm.model_copy(update={"fell": False}), "file:///trend.html")
    assert [event for event, _ in sent] == ["simyard.trend.Fell", "simyard.trend.Rose"]
    assert [name for name in sent[0][1] if f"`{name}`" not in TEXT] == []


def test_its_table_has_the_rows_of_the_benchmark_and_no_rate_above_one_a_year():
    rows = re.findall(r"^\| (\d+ x \d+) +\| +(.*?) %.*?\| +([\d.]+) \| +([\d.]+) \|", DOCUMENT, re.MULTILINE)
    assert len(rows) == len(DESIGNS) * len(RATES) * len(CORRELATIONS)
    assert max(float(alarms) for *_, alarms in rows) <= 1.0


def test_a_history_without_a_change_alarms_no_more_than_once_a_year():
    assert false_alarms(seen_by_factors, Setting(0.99, 0.1, 8, 12), 3) <= 1.0
