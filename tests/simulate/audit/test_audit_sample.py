"""The sample of an audit: spread over the batch, half of it failed episodes, found without listing them all."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.episode import EpisodeResult, unfinished_result
from tasks.simulate.audit.audit_sample import audited_positions, draw_sample
from tasks.simulate.batch.stop import LEFT_OUT
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.layout import Layout
from tests.factories.episodes import canceled, collided, crashed, passed
from tests.factories.planned_batches import template

LANES = 50


def layout(seeds: int) -> Layout:
    plan = BatchPlan(
        templates=(template(),),
        worlds=("g/a", "g/b"),
        seeds=tuple(range(seeds)),
        sweep={},
        lanes=LANES,
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


def test_half_of_the_sample_failed_where_so_many_did():
    rows = Rows(100, 10)
    found = draw_sample(rows.layout, rows, 16)
    failed = [each for each in found if each.row.outcome == "Failed"]
    assert len([each for each in failed if not each.spread]) <= 8
    assert len(failed) >= 8
    assert sum(each.spread for each in found) == 8
    assert [each.request.index for each in found] == [each.row.index for each in found]


def test_without_failures_all_are_evenly_spread():
    rows = Rows(100, 10**9)
    found = draw_sample(rows.layout, rows, 16)
    # the first one collides: 0 is a multiple of everything
    assert len([each for each in found if each.spread]) >= 15


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


@given(st.integers(1, 100_000), st.integers(1, 64), st.text(), st.integers(1, 30))
def test_one_position_is_drawn_from_each_of_equal_stretches(episodes: int, lanes: int, seed: str, cycle: int):
    positions = audited_positions(episodes, lanes, seed, cycle)
    count = min(lanes, episodes)
    assert len(positions) == count
    for k, position in enumerate(positions):
        assert episodes * k // count <= position < episodes * (k + 1) // count


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
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize(("episodes", "cycle"), [(48, 3), (48, 1), (50, 3), (96, 2)])
def test_every_episode_is_about_as_likely_as_another(episodes: int, cycle: int):
    counts = [0] * episodes
    for seed in range(2000):
        for position in audited_positions(episodes, 8, str(seed), cycle):
            counts[position] += 1
    mean = 2000 * 8 / episodes
    assert 0.6 * mean < min(counts) <= max(counts) < 1.6 * mean


def test_another_plan_has_another_sample():
    one, other = (audited_positions(10_000, 16, seed) for seed in ("a", "b"))
    assert one != other
    rows, others = Rows(1000, 10**9), Rows(1001, 10**9)
    indices = [{each.request.index for each in draw_sample(each.layout, each, 16)} for each in (rows, others)]
    assert indices[0] != indices[1]


def test_of_a_batch_that_was_ended_early_what_was_driven_is_audited():
    whole = layout(400)
    early, read = Layout(whole.plan.model_copy(update={"shuffled": True})), list[int]()

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


def test_a_shuffled_batch_that_ran_to_its_end_is_audited_as_any_other():
    rows = Rows(100, 10)
    rows.layout = Layout(rows.layout.plan.model_copy(update={"shuffled": True}))
    found = draw_sample(rows.layout, rows, 16)
    assert max(each.request.index for each in found) > 150
