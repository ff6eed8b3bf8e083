"""What an application is told of the job that it is in."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.arn import ArnForm
from specs.data.episode import EpisodeRequest
from tasks.simulate.plan.chunks import (
    JOB_ARN,
    JOB_ID,
    RUN_ID,
    Shuffle,
    job_variables,
    plan_chunks,
    program_key,
    split_environment,
    without_job_variables,
)
from tests.factories.simulations import delivery, pushing

FORM = ArnForm("0123456789ab", "us-west-2")
BATCH = "simb-0123456789abcdef"


def test_a_jobs_id_is_what_its_arn_ends_in():
    told = job_variables(FORM, BATCH, 12)
    assert told[JOB_ID] == "sim-0123456789abcdef12"
    assert told[JOB_ARN] == f"arn:aws:robomaker:us-west-2:{FORM.account}:simulation-job/sim-0123456789abcdef12"
    assert re.fullmatch("run-[0-9a-f]{16}", told[RUN_ID])


def test_each_job_has_its_own_and_always_the_same():
    told = [job_variables(FORM, BATCH, index) for index in (0, 1, 0)]
    assert told[0] == told[2]
    assert not set(told[0].values()) & set(told[1].values())


def test_what_tells_jobs_apart_decides_no_program():
    asked = delivery(0, world="g/w")
    own = asked.model_copy(update={"environment": {**asked.environment, **job_variables(FORM, BATCH, 0)}})
    assert program_key(own) == program_key(asked)
    assert without_job_variables(own.environment) == asked.environment


@st.composite
def batches(draw: st.DrawFn) -> list[EpisodeRequest]:
    kinds = draw(st.lists(st.booleans(), max_size=40))
    return [
        delivery(k, world="w", speed=draw(st.sampled_from(["0.3", "0.6", "fast"])))
        if courier
        else pushing(k, world="w")
        for k, courier in enumerate(kinds)
    ]


@given(batches(), st.integers(1, 9))
def test_every_episode_is_in_one_chunk_of_its_program(requests: list[EpisodeRequest], lanes: int):
    chunks = plan_chunks(requests, lanes)
    assert [chunk.number for chunk in chunks] == list(range(len(chunks)))
    assert sorted(r.index for chunk in chunks for r in chunk.requests) == [r.index for r in requests]
    for chunk in chunks:
        assert 1 <= len(chunk.requests) <= lanes
        assert len({program_key(request) for request in chunk.requests}) == 1


@given(batches(), st.integers(1, 9))
def test_only_the_last_chunk_of_a_program_is_not_full(requests: list[EpisodeRequest], lanes: int):
    chunks = plan_chunks(requests, lanes)
    full = [chunk for chunk in chunks if len(chunk.requests) == lanes]
    programs = {program_key(request) for request in requests}
    assert len(chunks) - len(full) <= len(programs)


def test_numeric_variables_share_a_program_and_texts_do_not():
    slow, fast = delivery(0, world="w", speed="0.3"), delivery(1, world="w", speed="6e-1")
    named = delivery(2, world="w", speed="fast")
    assert program_key(slow) == program_key(fast) != program_key(named)


def test_a_value_for_another_variable_is_another_program():
    request = delivery(0, world="w")
    other = request.model_copy(update={"environment": {"MIN_SPEED": "0.6"}})
    assert program_key(request) != program_key(other)


def test_another_command_of_a_container_image_is_another_program_and_another_launch_in_tables():
    request = delivery(0, world="w")
    launches = [
        request.robot.model_copy(update={"launch_file": "", "command": ("roslaunch", "roamer", name)})
        for name in ("a.launch", "b.launch")
    ]
    first, second = (request.model_copy(update={"robot": each}) for each in launches)
    assert program_key(first) != program_key(second)
    assert [each.launched for each in launches] == ["roslaunch roamer a.launch", "roslaunch roamer b.launch"]


@pytest.mark.parametrize("text", ["nan", "inf", "1e999", "1_000", "0x10", "", " 1", "-", "fast"])
def test_what_is_no_plain_finite_number_stays_a_text(text: str):
    assert split_environment({"NAME": text}) == ({}, {"NAME": text})


def test_no_lanes_are_refused():
    with pytest.raises(ValueError, match="at least 1"):
        plan_chunks([], 0)


@given(st.integers(0, 200), st.text(max_size=3))
def test_each_position_has_one_turn(size: int, seed: str):
    shuffle = Shuffle(size, seed)
    assert sorted(shuffle.order) == list(range(size))
    assert [shuffle.order[turn] for turn in shuffle.turn] == list(range(size))


def test_the_order_follows_from_the_seed_and_is_the_same_on_any_machine():
    assert Shuffle(8, "simyard").order == (3, 4, 7, 2, 6, 1, 5, 0)
    assert Shuffle(100, "a").order != Shuffle(100, "b").order
