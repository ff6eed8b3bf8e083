"""What chunks took is remembered by program, and forgotten without harm."""

from pathlib import Path

import pytest

from specs.field_types import EngineName
from tasks.simulate.chunk import byproducts
from tasks.simulate.chunk.byproducts import (
    ChunkTiming,
    ChunkWatch,
    TurnWatch,
    recall_engine_timings,
    recall_timings,
    remember_timing,
)

PROGRAM, OTHER = ("courier", "delivery"), ("courier", "coverage")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def timing(engine: EngineName = "planar", ready_s: float = 1.0) -> ChunkTiming:
    return ChunkTiming(
        engine=engine,
        device="cpu",
        lanes=16,
        episodes=12,
        ready_s=ready_s,
        compile_s=2.0,
        slices=40,
        slices_s=3.0,
        most_slices=47,
        peak_bytes=1,
    )


def test_a_program_has_its_own_timings():
    remember_timing(PROGRAM, timing(ready_s=1.0))
    remember_timing(PROGRAM, timing("mujoco", ready_s=2.0))
    remember_timing(OTHER, timing(ready_s=3.0))
    assert [each.ready_s for each in recall_timings(PROGRAM)] == [1.0, 2.0]
    assert sorted(each.ready_s for each in recall_engine_timings("planar", "cpu")) == [1.0, 3.0]
    assert recall_engine_timings("planar", "gpu") == []


def test_only_the_last_ones_are_kept():
    for number in range(20):
        remember_timing(PROGRAM, timing(ready_s=float(number)))
    assert [each.ready_s for each in recall_timings(PROGRAM)] == [float(number) for number in range(8, 20)]


def test_a_file_of_another_version_and_a_folder_that_is_none_are_no_memory(cache: Path):
    remember_timing(PROGRAM, timing())
    (file,) = (cache / "timings").glob("*.json")
    file.write_text('[{"engine": "planar"}]')
    assert recall_timings(PROGRAM) == []
    file.unlink()
    (cache / "timings").rmdir()
    (cache / "timings").write_text("a file")
    remember_timing(PROGRAM, timing())
    assert recall_timings(PROGRAM) == []


def test_a_watch_tells_readying_and_slices_apart():
    watch = ChunkWatch()
    for _ in range(5):
        watch.mark()
    taken = watch.timing("planar", "cpu", lanes=16, episodes=3, most_slices=9)
    assert taken
    assert (taken.slices, taken.most_slices, taken.lanes, taken.episodes) == (4, 9, 16, 3)
    assert min(taken.ready_s, taken.compile_s, taken.slices_s) >= 0.0
    assert taken.peak_bytes > 1 << 20


@pytest.mark.parametrize("when", ["ready", "first slice", "later slice"])
def test_compiling_is_counted_once_whenever_it_is_done(when: str, monkeypatch: pytest.MonkeyPatch):
    at_s, compiled_s = 0.0, 0.0

    def passed(seconds: float, *, compiling: bool) -> None:
        nonlocal at_s, compiled_s
        at_s, compiled_s = at_s + seconds, compiled_s + compiling * seconds

    monkeypatch.setattr(byproducts, "compiled_s", lambda: compiled_s)
    monkeypatch.setattr(byproducts, "monotonic", lambda: at_s)
    watch, turns = ChunkWatch(), TurnWatch()
    for step in ("ready", "first slice", "later slice"):
        passed(1.0, compiling=False)
        passed(16.0 * (step == when), compiling=True)
        watch.mark()
        (turns.placed if step == "ready" else turns.drove)(1.0)
    alone = watch.timing("planar", "cpu", lanes=16, episodes=3, most_slices=9)
    shared = turns.timing("planar", lanes=16, episodes=3, most_slices=9)
    for taken in (alone, shared):
        assert taken is not None
        assert (taken.ready_s, taken.compile_s, taken.slices_s, taken.slices) == (1.0, 16.0, 2.0, 2)


def test_what_another_thread_compiles_meanwhile_is_not_the_chunk_s(monkeypatch: pytest.MonkeyPatch):
    at_s, compiled_s = 0.0, 100.0
    monkeypatch.setattr(byproducts, "monotonic", lambda: at_s)
    monkeypatch.setattr(byproducts, "get_ident", lambda: 1 if at_s < 10.0 else 2)
    monkeypatch.setattr(byproducts, "compiled_s", lambda: compiled_s if at_s < 10.0 else 0.0)
    watch = ChunkWatch()
    for later_s in (1.0, 3.0, 11.0, 12.0):  # the first slice is the last that the first thread drives
        at_s, compiled_s = later_s, compiled_s + 0.5
        watch.mark()
    taken = watch.timing("planar", "cpu", lanes=16, episodes=3, most_slices=9)
    assert taken is not None
    assert (taken.ready_s, taken.compile_s, taken.slices_s, taken.slices) == (0.5, 1.0, 1.5 + 8.0 + 1.0, 3)


def test_what_was_not_driven_took_nothing():
    watch = ChunkWatch()
    watch.mark()
    assert watch.timing("planar", "cpu", lanes=16, episodes=3, most_slices=9) is None
