"""The cost model grows where costs do, and follows what was measured."""

from hypothesis import given
from hypothesis import strategies as st

from specs.field_types import EngineName
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.forecast.batch_timing import (
    Span,
    compiling_s,
    driving_s,
    memory_bytes,
    probed_speed,
    remembered_speed,
)

ENGINES: st.SearchStrategy[EngineName] = st.sampled_from(["planar", "mjx", "mujoco"])


def timing(engine: EngineName, lanes: int, slices_s: float, slices: int = 47) -> ChunkTiming:
    return ChunkTiming(
        engine=engine,
        device="cpu",
        lanes=lanes,
        episodes=lanes,
        ready_s=0.5,
        compile_s=1.0,
        slices=slices,
        slices_s=slices_s,
        most_slices=47,
        peak_bytes=1 << 30,
    )


@given(ENGINES, st.integers(1, 512), st.floats(0.01, 100.0))
def test_a_chunk_like_those_before_takes_what_those_took(engine: EngineName, lanes: int, slices_s: float):
    speed = remembered_speed([timing(engine, lanes, slices_s)], lanes, same_program=True)
    assert speed
    span = driving_s(engine, speed, episodes=lanes, lanes=lanes, chunks=1, duration_s=60.0)
    assert span.low <= slices_s + 0.5 <= span.high
    assert span.high <= 1.6 * (slices_s * 48 / 47 + 0.5)


@given(ENGINES, st.integers(1, 256), st.integers(1, 20))
def test_more_lanes_chunks_and_seconds_take_longer(engine: EngineName, lanes: int, chunks: int):
    speed = probed_speed(2)

    def took(lanes: int, chunks: int, duration_s: float) -> Span:
        return driving_s(engine, speed, episodes=1, lanes=lanes, chunks=chunks, duration_s=duration_s)

    base = took(lanes, chunks, 60.0)
    assert all(base.high < more.high for more in (took(2 * lanes, chunks, 60.0), took(lanes, chunks + 1, 60.0)))
    assert base.high < took(lanes, chunks, 120.0).high


@given(ENGINES, st.integers(8, 512))
def test_ranges_are_ranges_and_a_memory_narrows_them(engine: EngineName, lanes: int):
    guess, known = probed_speed(2), remembered_speed([timing(engine, lanes, 5.0)], lanes, same_program=True)
    assert known
    for speed in (guess, known):
        for span in (compiling_s(engine, speed), memory_bytes(engine, speed, lanes)):
            assert 0.0 < span.low < span.high
    assert known.drive.high / known.drive.low < guess.drive.high / guess.drive.low
    seen = memory_bytes(engine, known, lanes)
    assert seen.low < 1 << 30 < seen.high


def test_memory_of_other_lane_counts_is_carried_over():
    known = remembered_speed([timing("planar", 64, 5.0)], 64, same_program=True)
    assert known
    assert memory_bytes("planar", known, 512).high > memory_bytes("planar", known, 64).high


def test_other_programs_say_nothing_of_memory_and_of_early_ends():
    other = remembered_speed([timing("planar", 64, 5.0, slices=10)], 64, same_program=False)
    assert other
    assert other.peak_bytes == {}
    assert other.share == Span(low=0.5, high=1.0)


def test_chunks_that_ended_in_their_first_slice_are_no_measure():
    assert remembered_speed([timing("planar", 64, 0.0, slices=0)], 64, same_program=True) is None


def test_chunks_of_another_size_are_asked_only_if_there_are_no_others():
    audit, chunk = timing("planar", 16, 50.0), timing("planar", 192, 5.0)
    alone = remembered_speed([chunk], 256, same_program=True)
    assert remembered_speed([audit, chunk], 256, same_program=True) == alone
    assert remembered_speed([audit], 256, same_program=True) is not None
