"""`simyard plan` says what worlds and seeds are worth, by what earlier batches showed."""

from types import SimpleNamespace

import pytest

from flows.preview.plan import SeenSpread, seen_spread, world_lines
from specs.pipeline.gate_section import Gate
from tasks.results.tables.history_rows import Cell
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import submit

HERE = Gate.model_validate({"successRate": {"atLeast": 0.9}})
OVER = Gate.model_validate({"successRate": {"atLeast": 0.9, "over": "worlds"}})


def told(gate: Gate, seen: SeenSpread | None, worlds: int = 8, seeds: int = 24) -> list[str]:
    return list(world_lines(gate, seen, episodes=384, worlds=worlds, seeds=seeds))


def test_where_no_rule_is_about_worlds_and_none_were_seen_to_differ_nothing_is_said():
    assert told(HERE, None) == []
    assert told(HERE, SeenSpread(3, 0.0)) == []


def test_without_an_earlier_batch_the_worth_is_said_for_three_correlations():
    assert told(OVER, None)[0] == (
        "no earlier batch: 8 worlds x 48 episodes are worth 384 / 115 / 67 independent ones at an ICC of 0 / 0.05 / 0.1"
    )


def test_earlier_batches_say_what_the_layout_is_worth_and_what_to_write():
    lines = told(HERE, SeenSpread(3, 0.14))
    assert lines[0].startswith("3 earlier batches: ICC 0.14; 8 worlds x 48 episodes are worth 51 independent ones")
    assert lines[-1] == "192 worlds x 2 would be worth 337: write worldCount: {floorplanCount: 192} and seeds: 1"


def test_a_layout_that_is_hardly_better_is_not_advised():
    assert len(told(OVER, SeenSpread(1, 0.05), 48, 4)) == 1
    assert len(told(OVER, None, 384, 1)) == 1


def test_no_more_worlds_are_advised_than_a_document_may_have():
    lines = list(world_lines(OVER, None, episodes=50_000, worlds=50, seeds=1_000))
    assert "write worldCount: {floorplanCount: 10000} and seeds: 5" in lines[-1]
    assert not any("50000" in line.partition("write")[2] for line in lines)


def test_the_spread_of_earlier_batches_is_that_of_their_worlds(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    assert seen_spread(file_store, "nightly") is None
    submit(file_store, "pipeline-run", {}, "run")
    cells = tuple(Cell(f"g/{world}", "b", (), passed, 8) for world, passed in enumerate([8, 8, 8, 0]))
    night = SimpleNamespace(cells=cells, request="r", begun_at_s=1.0)
    monkeypatch.setattr("flows.batch.trend_history.read_history", lambda *_: SimpleNamespace(nights=[night]))
    assert seen_spread(file_store, "nightly") == SeenSpread(1, 1.0)
    perfect = SimpleNamespace(cells=(Cell("g/a", "b", (), 8, 8),), request="r", begun_at_s=2.0)
    monkeypatch.setattr("flows.batch.trend_history.read_history", lambda *_: SimpleNamespace(nights=[perfect]))
    assert seen_spread(file_store, "nightly") == SeenSpread(1, None)
