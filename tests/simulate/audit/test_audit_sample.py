"""The sample of an audit: two strata, weights without bias, found without reading all chunks of a large batch."""

import math
from collections.abc import Callable, Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.episode import EpisodeResult, success, unfinished_result
from tasks.simulate.audit.audit_sample import Pick, SampledEpisode, draw_sample, stretches
from tasks.simulate.batch.batch_record import LEFT_OUT
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.episode_layout import Layout
from tests.factories.episodes import canceled, collided, crashed, passed
from tests.factories.planned_batches import template

LANES = 50


def layout(seeds: int, lanes: int = LANES) -> Layout:
    plan = BatchPlan(
        templates=(template(),),
        worlds=("g/a", "g/b"),
        seeds=tuple(range(seeds)),
        sweep={},
        lanes=lanes,
        timeout_s=1.0,
        world_digests={},
        engine="auto",
    )
    return Layout(plan)


class Rows:
    """The rows of a batch in which every so manieth collides; says which chunks were read."""

    def __init__(self, seeds: int, collides_each: int) -> None:
        self.layout, self.each, self.read = layout(seeds), collides_each, list[int]()

    def __call__(self, number: int) -> Sequence[EpisodeResult]:
        self.read.append(number)
        made = (request.index for request in self.layout.chunk(number).requests)
        return [collided(index) if index % self.each == 0 else passed(index) for index in made]


def test_a_quarter_of_the_lanes_goes_to_failures_and_the_rest_to_what_passed():
    rows = Rows(100, 10)
    found = draw_sample(rows.layout, rows, 16)
    assert [success(each.row) for each in found].count(False) == 4
    assert len(found) == 16
    assert [each.request.index for each in found] == [each.row.index for each in found]


@pytest.mark.parametrize(("each", "failed"), [(10**9, 1), (1, 16), (3, 4)])
def test_lanes_that_a_stratum_has_no_use_for_go_to_the_other(each: int, failed: int):
    rows = Rows(100, each)
    found = draw_sample(rows.layout, rows, 16)
    assert (len(found), [success(one.row) for one in found].count(False)) == (16, failed)


def test_weights_of_a_stratum_add_up_to_it():
    rows = Rows(100, 10)
    found = draw_sample(rows.layout, rows, 16)
    assert sum(each.weight for each in found if success(each.row)) == 180
    assert sum(each.weight for each in found if not success(each.row)) == 20


@pytest.mark.parametrize(("lanes", "audited"), [(4, 3), (2, 3), (4, 2), (3, 4)])
def test_over_all_samples_the_weighted_sum_is_that_of_the_batch(lanes: int, audited: int):
    small = layout(3, lanes)
    value = {0: 3.0, 1: 1.0, 2: 4.0, 3: 1.0, 4: 5.0, 5: 9.0}

    def rows_of(number: int) -> list[EpisodeResult]:
        return [collided(r.index) if r.index in {1, 4} else passed(r.index) for r in small.chunk(number).requests]

    expected = 0.0
    for chance, found in all_samples(lambda pick: draw_sample(small, rows_of, audited, pick)):
        expected += chance * sum(each.weight * value[each.row.index] for each in found)
    assert expected == pytest.approx(sum(value.values()), abs=1e-12)


class Script:
    """Picks what it is told, and the first thing where it is told nothing; knows below which numbers it picked."""

    def __init__(self, told: Sequence[int]) -> None:
        self.told, self.made = told, list[tuple[int, int]]()

    def __call__(self, _: str, below: int) -> int:
        position = len(self.made)
        self.made.append((self.told[position] if position < len(self.told) else 0, below))
        return self.made[-1][0]


def all_samples(
    draw: Callable[[Pick], list[SampledEpisode]],
) -> Iterator[tuple[float, list[SampledEpisode]]]:
    """Yields each sample that may be drawn, with its probability."""
    script = Script(())
    while True:
        found = draw(script)
        yield 1.0 / math.prod(below for _, below in script.made), found
        made = script.made
        while made and made[-1][0] + 1 == made[-1][1]:
            made.pop()
        if not made:
            return
        script = Script([*(picked for picked, _ in made[:-1]), made[-1][0] + 1])


def test_a_large_batch_is_not_read_as_a_whole():
    rows = Rows(50_000, 10)
    found = draw_sample(rows.layout, rows, 16)
    assert rows.layout.chunks == 2000
    assert len(rows.read) == len(set(rows.read)) <= 16
    assert len(found) <= 16


def test_what_was_canceled_or_never_began_is_left_out():
    made = {
        0: canceled(0),
        1: crashed(1).model_copy(update={"simulated_s": 0.0}),
        2: passed(2),
        3: collided(3),
    }
    small = layout(2)
    found = draw_sample(small, lambda number: [made[r.index] for r in small.chunk(number).requests], 16)
    assert [each.request.index for each in found] == [2, 3]


@given(st.integers(1, 400), st.integers(1, 50), st.integers(1, 64))
def test_the_sample_is_the_same_again_and_never_too_large(seeds: int, each: int, lanes: int):
    rows = Rows(seeds, each)
    found = draw_sample(rows.layout, rows, lanes)
    assert found == draw_sample(rows.layout, rows, lanes)
    assert 1 <= len(found) <= lanes


@given(st.integers(0, 100_000), st.integers(1, 64))
def test_stretches_cover_all_positions_and_are_about_equal(size: int, count: int):
    found = stretches(size, count)
    assert [position for stretch in found for position in stretch] == list(range(size))
    assert len(found) == min(size, count)
    assert not found or max(map(len, found)) - min(map(len, found)) <= 1


@pytest.mark.parametrize("swept", [1, 2, 3, 4, 5, 8, 16])
def test_every_value_of_a_sweep_is_audited(swept: int):
    speeds = [f"0.{k:02}" for k in range(1, swept + 1)]
    changes = {
        "sweep": {"MAX_SPEED": tuple(speeds)},
        "worlds": tuple(f"g/{k}" for k in range(128)),
        "seeds": (0,),
    }
    swept_layout = Layout(layout(1).plan.model_copy(update=changes))
    found = draw_sample(swept_layout, lambda number: [passed(r.index) for r in swept_layout.chunk(number).requests], 16)
    values = [each.request.environment["MAX_SPEED"] for each in found]
    counts = [values.count(speed) for speed in speeds]
    assert sum(counts) == 16
    assert max(counts) - min(counts) <= 2  # a stretch may reach from one value into the next
    assert min(counts) >= 16 // swept - 1 >= 0
    assert swept not in {1, 2, 4, 8, 16} or len(set(counts)) == 1


def test_another_plan_has_another_sample():
    rows, others = Rows(1000, 10**9), Rows(1001, 10**9)
    indices = [{each.request.index for each in draw_sample(each.layout, each, 16)} for each in (rows, others)]
    assert indices[0] != indices[1]


def test_of_a_batch_that_was_ended_early_what_was_driven_is_audited():
    whole = layout(400)
    early, read = Layout(whole.plan.model_copy(update={"shuffled": "episodes"})), list[int]()

    def rows_of(number: int) -> list[EpisodeResult]:
        read.append(number)
        indices = [request.index for request in early.chunk(number).requests]
        if number < 3:
            return [passed(index) for index in indices]
        return [unfinished_result(index, "Canceled", failure_code="", failure_reason=LEFT_OUT) for index in indices]

    found = draw_sample(early, rows_of, 16)
    assert len(found) == 16
    assert {early.chunk_of(each.request.index) for each in found} == {0, 1, 2}
    assert len(set(read)) <= 3 + 4  # of 16 chunks
    # Before it is ended there, its next chunks have no rows; the sample is that of its end.
    assert draw_sample(early, lambda number: rows_of(number) if number < 3 else (), 16, chunks=3) == found


def test_a_shuffled_batch_that_ran_to_its_end_is_audited_as_any_other():
    rows = Rows(100, 10)
    rows.layout = Layout(rows.layout.plan.model_copy(update={"shuffled": "episodes"}))
    found = draw_sample(rows.layout, rows, 16)
    assert max(each.request.index for each in found) > 150
