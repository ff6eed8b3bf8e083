"""What chunks took is told apart: making ready, compiling, driving."""

import pytest

from tasks.simulate.chunk import byproducts
from tasks.simulate.chunk.byproducts import ChunkWatch, TurnWatch


def test_a_watch_tells_readying_and_slices_apart():
    watch = ChunkWatch()
    for _ in range(5):
        watch.mark()
    taken = watch.timing(16)
    assert taken
    assert (taken.slices, taken.lanes) == (4, 16)
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
    alone = watch.timing(16)
    shared = turns.timing(16)
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
    taken = watch.timing(16)
    assert taken is not None
    assert (taken.ready_s, taken.compile_s, taken.slices_s, taken.slices) == (0.5, 1.0, 1.5 + 8.0 + 1.0, 3)


def test_what_was_not_driven_took_nothing():
    watch = ChunkWatch()
    watch.mark()
    assert watch.timing(16) is None
