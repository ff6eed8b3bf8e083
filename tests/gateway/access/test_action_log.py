"""Who did what: nothing is lost that was answered, and nobody overwrites another."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from specs.errors import StoreAway
from tasks.gateway.access.action_log import Action, ActionLog, actions
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store

DAY_S = 86_400
NOW_S = 1_800_000_000.0


class Clock:
    now_s = NOW_S

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def folder_store(tmp_path: Path) -> Store:
    return open_store(tmp_path.as_uri())


def action(request: str = "r", *, arns: tuple[str, ...] = (), outcome: str = "done") -> Action:
    return Action(request, "KEY", "ci", "127.0.0.1", "CreateFleet", arns, 200, outcome)


def lines(store: Store, days: int = 1, now_s: float = NOW_S) -> list[dict[str, object]]:
    return [json.loads(line) for line in actions(store, days, now_s)]


def test_a_line_says_who_did_what(folder_store: Store) -> None:
    ActionLog(folder_store, 90, Clock()).record(action("r-1", arns=("arn:simyard:robot:s:a",)))
    (line,) = lines(folder_store)
    assert line.pop("gateway")
    assert line == {
        "time": "2027-01-15T08:00:00.000000+00:00",
        "request": "r-1",
        "key": "KEY",
        "name": "ci",
        "client": "127.0.0.1",
        "operation": "CreateFleet",
        "outcome": "done",
        "status": 200,
        "arns": ["arn:simyard:robot:s:a"],
    }


def test_several_gateways_and_threads_lose_nothing(folder_store: Store) -> None:
    logs = [ActionLog(folder_store, 90, Clock()) for _ in range(3)]
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda number: logs[number % 3].record(action(f"r-{number}")), range(120)))
    assert {line["request"] for line in lines(folder_store)} == {f"r-{number}" for number in range(120)}
    assert len(lines(folder_store)) == 120


def test_a_line_is_in_the_store_before_its_call_is_answered(folder_store: Store) -> None:
    log = ActionLog(folder_store, 90, Clock())
    for number in range(3):
        log.record(action(f"r-{number}"))
        assert lines(folder_store)[-1]["request"] == f"r-{number}"


def test_a_file_that_grew_is_left_and_stays(folder_store: Store) -> None:
    log = ActionLog(folder_store, 90, Clock())
    for number in range(40):
        log.record(action(f"r-{number}", arns=("a" * 250,) * 20))
    assert len(folder_store.keys("actions")) == 4
    assert len(lines(folder_store)) == 40


def test_lines_of_all_days_come_in_their_order(folder_store: Store) -> None:
    clock = Clock()
    logs = [ActionLog(folder_store, 90, clock) for _ in range(2)]
    for number in range(6):
        clock.now_s = NOW_S + number * DAY_S / 4
        logs[number % 2].record(action(f"r-{number}"))
    assert [line["request"] for line in lines(folder_store, 2, clock.now_s)] == [f"r-{number}" for number in range(6)]
    assert len(lines(folder_store, 1, clock.now_s)) < 6


def test_old_days_are_forgotten(folder_store: Store) -> None:
    clock = Clock()
    ActionLog(folder_store, 2, clock).record(action("old"))
    clock.now_s += 2 * DAY_S
    ActionLog(folder_store, 2, clock).record(action("new"))
    assert len(lines(folder_store, 9, clock.now_s)) == 2
    clock.now_s += DAY_S
    ActionLog(folder_store, 2, clock).record(action("newer"))
    assert [line["request"] for line in lines(folder_store, 9, clock.now_s)] == ["new", "newer"]


def test_of_a_flood_of_refusals_few_lines_and_their_number_stay(folder_store: Store) -> None:
    clock = Clock()
    log = ActionLog(folder_store, 90, clock)
    for _ in range(200):
        log.record_refusal(action(outcome="AccessDeniedException"))
    assert len(lines(folder_store)) == 60
    clock.now_s += 61
    log.record_refusal(action(outcome="AccessDeniedException"))
    assert lines(folder_store)[-1]["refusalsLeftOut"] == 140


def test_a_line_is_bounded(folder_store: Store) -> None:
    log = ActionLog(folder_store, 90, Clock())
    log.record(action("r" * 10_000, arns=("arn:" + "x" * 5000,) * 5000))
    (line,) = actions(folder_store, 1, NOW_S)
    assert len(line) < 40_000
    assert json.loads(line)["arnsLeftOut"] == 4900


def test_text_of_a_stranger_stays_in_its_line(folder_store: Store) -> None:
    ActionLog(folder_store, 90, Clock()).record(action('x"}\n{"time": "forged\u2028\x1b[2J'))
    (line,) = actions(folder_store, 1, NOW_S)
    assert line.isascii()
    assert line.isprintable()


def test_a_line_that_the_store_did_not_take_goes_with_the_next(
    folder_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = ActionLog(folder_store, 90, Clock())

    def away(*_: object) -> str:
        raise StoreAway("away")

    with monkeypatch.context() as patch:
        patch.setattr(folder_store, "put", away)
        with pytest.raises(StoreAway):
            log.record(action("first"))
    log.record(action("second"))
    assert [line["request"] for line in lines(folder_store)] == ["first", "second"]


def test_what_waits_for_a_store_that_is_away_is_bounded_and_what_was_lost_is_said(
    folder_store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    clock = Clock()
    log = ActionLog(folder_store, 90, clock)
    taken: list[int] = []

    def away(_key: str, body: bytes) -> str:
        taken.append(len(body))
        raise StoreAway("away")

    arns = ("arn:" + "x" * 200,) * 100
    with monkeypatch.context() as patch:
        patch.setattr(folder_store, "put", away)
        for number in range(100):
            clock.now_s += 1
            with pytest.raises(StoreAway):
                log.record(action(f"r-{number}", arns=arns))
    assert max(taken) < (1 << 20) + 2 * taken[0]
    clock.now_s += 1
    log.record(action("last", arns=arns))

    lost, *kept = lines(folder_store)
    assert [line["request"] for line in kept] == [
        *(f"r-{number}" for number in range(100 - len(kept) + 1, 100)),
        "last",
    ]
    assert lost["linesLost"] == 101 - len(kept)
    assert str(lost["lostSince"]) < str(lost["time"]) < str(kept[0]["time"])
    assert "lines of the log of actions are lost" in caplog.text
    log.record(action("after", arns=arns))
    assert sum("linesLost" in line for line in lines(folder_store)) == 1
