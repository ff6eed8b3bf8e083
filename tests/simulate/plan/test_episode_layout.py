"""Episodes and chunks of a plan, computed for any place, are those of the plan written out."""

import itertools
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.episode import EpisodeRequest
from tasks.simulate.batch.result_stream import request_columns
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate, lane_count
from tasks.simulate.plan.chunks import plan_chunks, program_key
from tasks.simulate.plan.episode_layout import Layout
from tests.factories.simulations import PUSHER, ROBOT, SCENARIO

TEMPLATE = JobTemplate(
    robot=ROBOT, scenario=SCENARIO, environment={}, duration_s=1.0, failure_behavior="Fail"
)  # fmt: skip
VALUES = st.lists(st.sampled_from(["0.3", "0.6", "1e1", "fast", "slow"]), min_size=1, max_size=3, unique=True)


@st.composite
def templates(draw: st.DrawFn) -> JobTemplate:
    return JobTemplate(
        robot=draw(st.sampled_from([ROBOT, PUSHER])),
        scenario=SCENARIO,
        environment=draw(st.dictionaries(st.sampled_from("ABC"), st.sampled_from(["1", "2", "x"]), max_size=2)),
        duration_s=float(draw(st.integers(1, 3))),
        failure_behavior="Fail",
        worlds=draw(st.sampled_from([(), ("own/world",)])),
    )


@st.composite
def plans(draw: st.DrawFn) -> BatchPlan:
    asked = draw(st.lists(templates(), min_size=1, max_size=4))
    if draw(st.booleans()):  # requests with seeds of their own, which the matrix does not multiply
        asked = [each.model_copy(update={"seed": draw(st.sampled_from([None, 0, 7, 2**32 - 1]))}) for each in asked]
    most = 3 if all(each.seed is None for each in asked) else 1
    return BatchPlan(
        templates=tuple(asked),
        worlds=tuple(f"g/w{number}" for number in range(draw(st.integers(0, 3)))),
        seeds=tuple(draw(st.lists(st.integers(0, 9), min_size=1, max_size=most, unique=True))),
        sweep={name: tuple(draw(VALUES)) for name in draw(st.lists(st.sampled_from("BCD"), max_size=2, unique=True))},
        lanes=draw(st.integers(1, 7)),
        timeout_s=1.0,
        world_digests={},
        engine="auto",
        shuffled=draw(st.sampled_from([False, "episodes"])),
    )


@st.composite
def plans_of_several(draw: st.DrawFn) -> BatchPlan:
    robots = draw(st.integers(2, 4))
    return draw(plans()).model_copy(update={"robots": robots, "lanes": robots * draw(st.integers(1, 3))})


@given(plans_of_several())
def test_robots_that_share_a_world_are_in_one_chunk_side_by_side(plan: BatchPlan):
    layout, robots = Layout(plan), plan.robots or 0
    chunks = [layout.chunk(number).requests for number in range(layout.chunks)]
    assert sorted(each.index for chunk in chunks for each in chunk) == [*range(layout.episodes)]
    for chunk in chunks:
        for first in range(0, len(chunk), robots):
            group = chunk[first : first + robots]
            assert [each.number for each in group] == [*range(robots)]
            assert [each.index for each in group] == [*range(group[0].index, group[0].index + robots)]
            assert len({(each.world, each.seed, each.robot, *sorted(each.environment.items())) for each in group}) == 1
            assert len({each.own_seed for each in group}) == robots
            assert layout.whole(group[-1:]) == list(group)
    alone = Layout(plan.model_copy(update={"robots": None}))
    assert [each.seed for each in layout.requests()][::robots] == [each.seed for each in alone.requests()]


@given(plans_of_several(), st.data())
def test_chunks_of_robots_that_share_worlds_are_found(plan: BatchPlan, data: st.DataObject):
    layout = Layout(plan)
    first = data.draw(st.integers(0, layout.episodes))
    end = data.draw(st.integers(first, layout.episodes))
    chunks = [layout.chunk(number).requests for number in range(layout.chunks)]
    assert [layout.chunk_size(number) for number in range(layout.chunks)] == [*map(len, chunks)]
    holding = [number for number, chunk in enumerate(chunks) if any(first <= each.index < end for each in chunk)]
    assert layout.chunks_between(first, end) == holding
    assert list(request_columns(layout, first, end)) == list(layout.requests(first, end))


def written_out(plan: BatchPlan) -> list[EpisodeRequest]:
    names = sorted(plan.sweep)
    settings = [dict(zip(names, values, strict=True)) for values in itertools.product(*(plan.sweep[n] for n in names))]
    multiplied = (
        (template, *rest)
        for template in plan.templates
        for rest in itertools.product(
            plan.worlds_of(template), settings, plan.seeds if template.seed is None else [template.seed]
        )
    )
    return [
        EpisodeRequest(
            index=index,
            world=world,
            seed=seed,
            robot=template.robot,
            scenario=template.scenario,
            environment={**template.environment, **setting},
            duration_s=template.duration_s,
        )
        for index, (template, world, setting, seed) in enumerate(multiplied)
    ]


@given(plans())
def test_episodes_come_by_request_world_parameters_and_seed(plan: BatchPlan):
    layout = Layout(plan)
    assert list(layout.requests()) == written_out(plan)
    assert layout.episodes == len(written_out(plan))


@given(plans())
def test_chunks_are_those_of_the_list_of_all_episodes(plan: BatchPlan):
    layout = Layout(plan.model_copy(update={"shuffled": False}))
    assert [layout.chunk(number) for number in range(layout.chunks)] == plan_chunks(written_out(plan), plan.lanes)


@given(plans())
def test_shuffled_chunks_have_the_same_programs_and_sizes_and_each_episode_once(plan: BatchPlan):
    ordered, layout = (Layout(plan.model_copy(update={"shuffled": shuffled})) for shuffled in (False, "episodes"))
    chunks = [layout.chunk(number).requests for number in range(layout.chunks)]
    plain = [ordered.chunk(number).requests for number in range(ordered.chunks)]
    assert [len(chunk) for chunk in chunks] == [len(chunk) for chunk in plain]
    assert [program_key(chunk[0]) for chunk in chunks] == [program_key(chunk[0]) for chunk in plain]
    assert all(len({program_key(request) for request in chunk}) == 1 for chunk in chunks)
    assert all(list(chunk) == sorted(chunk, key=lambda request: request.index) for chunk in chunks)
    everyone = sorted((request for chunk in chunks for request in chunk), key=lambda request: request.index)
    assert everyone == written_out(plan)


def test_any_beginning_of_a_shuffled_batch_has_episodes_of_all_its_worlds():
    plan = BatchPlan(
        templates=(TEMPLATE,),
        worlds=tuple(f"g/w{number}" for number in range(8)),
        seeds=tuple(range(48)),
        sweep={},
        lanes=64,
        timeout_s=1.0,
        world_digests={},
        engine="auto",
        shuffled="episodes",
    )
    for number in range(6):
        found = Counter(request.world for request in Layout(plan).chunk(number).requests)
        assert len(found) == 8
        assert max(found.values()) < 24
    other = Layout(plan.model_copy(update={"seeds": tuple(range(1, 49))}))
    assert [r.index for r in other.chunk(0).requests] != [r.index for r in Layout(plan).chunk(0).requests]


@given(plans())
def test_versions_that_take_turns_drive_the_same_episodes_in_each_two_chunks(plan: BatchPlan):
    asked = plan.templates[0]
    other = asked.model_copy(update={"robot": asked.robot.model_copy(update={"digest": "9" * 64})})
    sweep = dict.fromkeys(plan.sweep, ("1", "2"))
    layout = Layout(plan.model_copy(update={"templates": (asked, other), "sweep": sweep, "shuffled": "pairs"}))
    if not layout.episodes:
        return
    assert layout.in_pairs()
    chunks = [layout.chunk(number).requests for number in range(layout.chunks)]
    for old, new in zip(chunks[::2], chunks[1::2], strict=True):
        without = {"index": 0, "robot": asked.robot}
        assert [each.model_copy(update=without) for each in old] == [each.model_copy(update=without) for each in new]
    sizes = itertools.accumulate(len(chunk) for chunk in chunks[::2])
    assert layout.looks() == tuple(sizes)
    assert sorted(each.index for chunk in chunks for each in chunk) == [*range(layout.episodes)]
    assert all(layout.chunk_of(each.index) == number for number, chunk in enumerate(chunks) for each in chunk)
    assert [layout.chunk_size(number) for number in range(layout.chunks)] == [*map(len, chunks)]
    assert layout.chunks_between(0, layout.episodes) == [*range(layout.chunks)]


def test_programs_that_are_asked_for_other_episodes_are_no_pairs():
    other = TEMPLATE.model_copy(update={"robot": TEMPLATE.robot.model_copy(update={"digest": "9" * 64})})
    base = {"worlds": ("g/w0",), "seeds": (1, 2), "sweep": {}, "lanes": 4, "timeout_s": 1.0, "world_digests": {}}
    for templates in ((TEMPLATE,), (TEMPLATE, other.model_copy(update={"duration_s": 2.0}))):
        assert not Layout(BatchPlan.model_validate({**base, "engine": "auto", "templates": templates})).in_pairs()


@given(plans(), st.data())
def test_every_episode_is_found_in_its_chunk_and_its_request(plan: BatchPlan, data: st.DataObject):
    layout = Layout(plan)
    if layout.episodes:
        index = data.draw(st.integers(0, layout.episodes - 1))
        chunk = layout.chunk(layout.chunk_of(index))
        assert layout.request(index) in chunk.requests
        assert layout.request(index).robot == plan.templates[layout.template_of(index)].robot


@given(plans(), st.data())
def test_the_chunks_of_a_range_are_all_that_hold_some_of_it(plan: BatchPlan, data: st.DataObject):
    layout = Layout(plan)
    first = data.draw(st.integers(0, layout.episodes))
    end = data.draw(st.integers(first, layout.episodes))
    holding = [
        number
        for number in range(layout.chunks)
        if any(first <= request.index < end for request in layout.chunk(number).requests)
    ]
    assert layout.chunks_between(first, end) == holding


@pytest.mark.parametrize("number", [-1, 10**9])
def test_what_is_not_there_is_refused(number: int):
    plan = BatchPlan(
        templates=(JobTemplate(
            robot=ROBOT, scenario=SCENARIO, environment={}, duration_s=1.0, failure_behavior="Fail"),),
        worlds=("g/w",), seeds=tuple(range(10_000)), sweep={"A": tuple(map(str, range(1000)))},
        lanes=256, timeout_s=1.0, world_digests={}, engine="auto",
    )  # fmt: skip
    with pytest.raises(IndexError, match="there are 10000000"):
        Layout(plan).request(number if number < 0 else 10**7)
    with pytest.raises(IndexError, match="there are 39063"):
        Layout(plan).chunk(number)


@pytest.mark.parametrize(
    ("asked", "episodes", "lanes"),
    [(None, 100_000, 256), (1000, 100_000, 1000), (10**6, 100_000, 4096), (None, 20, 32), (7, 20, 7), (64, 0, 1)],
)
def test_lanes_are_the_concurrency_asked_for_as_far_as_it_is_of_use(asked: int | None, episodes: int, lanes: int):
    assert lane_count(asked, episodes) == lanes


@given(plans(), st.integers(0, 40), st.integers(0, 40))
def test_a_stretch_of_episodes_as_columns_is_the_same_requests(plan: BatchPlan, low: int, count: int):
    layout = Layout(plan)
    first = min(low, layout.episodes)
    end = min(first + count, layout.episodes)
    assert [*request_columns(layout, first, end)] == [*layout.requests(first, end)]
