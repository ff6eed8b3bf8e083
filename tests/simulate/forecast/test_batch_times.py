"""What batches took before says what the next one takes."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from specs.data.people import People
from tasks.progress.log_lines import log_duration
from tasks.simulate.batch.metrics import METRICS, metrics_of, work_of
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.forecast import batch_times
from tasks.simulate.forecast.batch_times import (
    BatchTiming,
    BatchWatch,
    compiling_s,
    process_age_s,
    recall_batches,
    remember_batch,
    remembered_bytes,
    remembered_wall_s,
)
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun
from tests.simulate.forecast.test_forecast import plan

LOAD_S = 1.5
WARM = BatchTiming(
    episodes=40,
    worlds=5,
    before_s=8.0,
    worlds_s=2.0,
    once_s=0.0,
    chunks_s=11.0,
    compile_s=1.0,
    after_s=6.0,
    audit_compile_s=1.0,
)
COLD = WARM.model_copy(update={"chunks_s": 22.0, "compile_s": 12.0, "after_s": 9.0, "audit_compile_s": 4.0})
TOOK_S = 8.0 + 11.0 + 6.0


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gives each test a cache folder of its own."""
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def told_s(known: list[BatchTiming], episodes: int = 40, of: BatchPlan | None = None) -> float:
    span = remembered_wall_s(known, of or plan(), episodes, LOAD_S)
    assert span
    assert span.low < span.middle < span.high
    return span.middle


def test_a_batch_takes_what_it_took():
    assert told_s([WARM]) == pytest.approx(TOOK_S)


def test_what_was_compiled_once_is_loaded_from_then_on():
    assert told_s([COLD]) == pytest.approx(TOOK_S, rel=0.1)
    assert told_s([COLD, WARM]) == pytest.approx(TOOK_S)


def test_how_long_compiling_took_is_known_beside_what_loading_takes():
    assert compiling_s([COLD, WARM], LOAD_S) == pytest.approx(12.0 + 4.0 - 1.0 - 1.0)
    assert compiling_s([COLD], LOAD_S) == pytest.approx(12.0 + 4.0 - 2 * LOAD_S)
    assert compiling_s([WARM], LOAD_S) == 0.0
    assert compiling_s([], LOAD_S) == 0.0


def test_what_batches_without_people_took_says_nothing_of_one_with_them():
    remember_batch(plan(), WARM)
    among_people = plan(people=People(count=2))
    assert recall_batches(among_people) == []
    remember_batch(among_people, COLD)
    assert recall_batches(plan(people=People(count=4))) == [COLD]


def test_more_episodes_take_longer_and_are_known_less():
    assert TOOK_S + 10.0 < told_s([WARM], 200) < TOOK_S + 50.0
    wide, narrow = (remembered_wall_s([WARM], plan(), episodes, LOAD_S) for episodes in (400, 40))
    assert wide
    assert narrow
    assert wide.high / wide.low > narrow.high / narrow.low


def test_the_run_of_most_like_size_is_asked():
    large = WARM.model_copy(update={"episodes": 4000, "chunks_s": 900.0})
    assert told_s([WARM, large]) == pytest.approx(TOOK_S)


def test_more_worlds_take_longer_to_make():
    assert told_s([WARM], of=plan(worlds=tuple(f"w/{number}" for number in range(50)))) > TOOK_S + 10.0


@pytest.mark.parametrize("age_s", [100.0, 3 * 3600.0])
def test_the_age_of_a_process_that_was_there_before_its_run_is_no_time_of_the_run(age_s: float):
    aged, unknown = (WARM.model_copy(update={"before_s": before_s, "worlds_s": 0.0}) for before_s in (age_s, None))
    for worlds in (5, 50):
        many = plan(worlds=tuple(f"w/{number}" for number in range(worlds)))
        assert told_s([aged], of=many) == told_s([unknown], of=many) < TOOK_S


def test_a_run_that_makes_many_worlds_before_its_batch_takes_as_long_again():
    large = WARM.model_copy(update={"worlds": 1000, "before_s": 106.0, "worlds_s": 100.0})
    many = plan(worlds=tuple(f"w/{number}" for number in range(1000)))
    assert told_s([large], of=many) == pytest.approx(106.0 + TOOK_S - 8.0)


def test_a_batch_that_went_on_with_the_worlds_that_were_there_does_not_say_that_none_take_time():
    went_on = WARM.model_copy(update={"before_s": 6.0, "worlds_s": 0.0})
    assert told_s([WARM, went_on]) == pytest.approx(TOOK_S)


def test_what_only_a_first_run_pays_before_its_chunks_is_left_out():
    first = WARM.model_copy(update={"before_s": 12.5, "once_s": 4.5})
    assert told_s([first]) == pytest.approx(TOOK_S)


def test_a_batch_of_few_worlds_says_what_many_take_and_the_other_way_round():
    many = plan(worlds=tuple(f"w/{number}" for number in range(50)))
    assert told_s([WARM], of=many) == pytest.approx(TOOK_S + 18.0)
    large = WARM.model_copy(update={"worlds": 50, "before_s": 26.0, "worlds_s": 20.0})
    assert told_s([large]) == pytest.approx(TOOK_S)


def test_seeds_and_worlds_share_a_memory_that_another_audit_does_not():
    remember_batch(plan(), WARM)
    assert recall_batches(plan(seeds=9, worlds=("w/1",))) == [WARM]
    assert recall_batches(plan(audit=8)) == []
    assert remembered_wall_s([], plan(), 40, LOAD_S) is None


def test_the_last_batches_are_kept():
    for number in range(20):
        remember_batch(plan(), WARM.model_copy(update={"episodes": number + 1}))
    assert [each.episodes for each in recall_batches(plan())] == list(range(13, 21))


def test_only_batches_that_were_remembered_last_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(batch_times, "_FILES_KEPT", 3)
    for lanes in range(1, 6):
        remember_batch(plan(lanes=lanes), WARM)
        os.utime(batch_times._batches_file(plan(lanes=lanes)), ns=(lanes, lanes))
    assert [bool(recall_batches(plan(lanes=lanes))) for lanes in range(1, 6)] == [False, False, True, True, True]


def test_the_memory_of_the_last_batch_that_says_it_is_what_the_next_one_takes():
    held = [WARM.model_copy(update={"peak_bytes": bytes_}) for bytes_ in (1 << 32, 1 << 30, 0)]
    assert remembered_bytes([WARM]) is None
    span = remembered_bytes(held)
    assert span
    assert span.low < 1 << 30 < span.high < 1 << 32


def test_a_process_knows_its_age():
    age_s = process_age_s()
    assert age_s is None or 0.0 < age_s < 1e6


def test_what_more_cores_took_says_nothing_of_fewer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(batch_times, "device_count", lambda: 2)
    remember_batch(plan(), WARM)
    assert recall_batches(plan()) == [WARM]
    monkeypatch.setattr(batch_times, "device_count", lambda: 1)
    assert recall_batches(plan()) == []


DROVE = ChunkTiming(lanes=4, ready_s=1.0, compile_s=2.5, slices=3, slices_s=2.0, peak_bytes=1 << 30)


@pytest.fixture
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A cache of its own, and a clock that a test sets."""
    now_s = [100.0]
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(
        batch_times,
        "time",
        SimpleNamespace(monotonic=lambda: now_s[0]),
    )
    return now_s


def kept(store: Store, clock: list[float], *audited: ChunkTiming) -> BatchTiming:
    """Returns what is remembered of a batch that drove for 10 s, and was audited for 4 s."""
    batch = begun(store)
    watch = BatchWatch()
    clock[0] += 10.0
    watch.drove()
    clock[0] += 4.0
    metrics = metrics_of(
        work_of([DROVE] * 3, simulated_s=1.0, wall_s=10.0)._replace(chunks=batch.layout.chunks), 10.0, 1
    )
    detail = {**batch.record().detail, METRICS: metrics.model_dump(mode="json")}
    watch.keep(batch, batch.record().model_copy(update={"status": "Completed", "detail": detail}), [DROVE] * 3, audited)
    return recall_batches(batch.plan)[-1]


def test_the_worlds_of_a_batch_are_those_made_since_the_batch_before(file_store: Store, clock: list[float]):
    BatchWatch()
    with log_duration("generate_worlds"):
        pass
    first, second = kept(file_store, clock), kept(file_store, clock)
    assert first.worlds_s > 0.0 == second.worlds_s


def test_making_prefects_database_is_paid_once(file_store: Store, clock: list[float]):
    before_s = kept(file_store, clock).once_s
    with log_duration("make_server_database"):
        pass
    assert kept(file_store, clock).once_s > before_s


def test_what_an_audit_compiled_while_it_drove_is_no_part_of_what_its_driving_took(
    file_store: Store, clock: list[float]
):
    timing = kept(file_store, clock, DROVE, DROVE)
    assert (timing.chunks_s, timing.compile_s, timing.after_s) == (10.0, 7.5, 4.0)
    assert timing.after_s - timing.audit_compile_s == DROVE.ready_s + DROVE.slices_s
    assert timing.peak_bytes == DROVE.peak_bytes
