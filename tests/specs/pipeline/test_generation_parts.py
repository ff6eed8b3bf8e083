"""A document's worlds in blocks of 50: each world once, in order, and each job under a token of its own."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import JsonValue

from specs.pipeline.generation_parts import generation_parts, generation_tokens


@settings(max_examples=40)
@given(st.integers(1, 130), st.integers(1, 130), st.integers(1, 60))
def test_all_worlds_are_in_one_part_each_and_no_part_is_too_large(plans: int, interiors: int, most: int):
    parts = generation_parts(plans, interiors, most)
    made = [
        (part.first_floorplan + plan, part.first_interior + interior)
        for part in parts
        for plan in range(part.floorplans)
        for interior in range(part.interiors)
    ]
    assert made == [(plan, interior) for plan in range(1, plans + 1) for interior in range(1, interiors + 1)]
    assert max(part.floorplans * part.interiors for part in parts) <= most
    assert [part.number for part in parts] == list(range(1, len(parts) + 1))


@pytest.mark.parametrize(("plans", "interiors"), [(1, 1), (48, 1), (10, 5), (1, 50)])
def test_what_one_job_makes_is_one_part_with_the_sections_token(plans: int, interiors: int):
    (part,) = generation_parts(plans, interiors)
    assert part.first == (1, 1)
    assert part.token("run-1-worlds") == "run-1-worlds"


def test_later_jobs_have_tokens_of_their_own_that_are_not_too_long():
    section: JsonValue = {"worldCount": {"floorplanCount": 384}}
    tokens = generation_tokens(section, "t" * 64)
    assert len(set(tokens)) == 8
    assert max(map(len, tokens)) == 64
    assert generation_tokens(section, f"run-{16 * '0'}-worlds")[1] == f"run-{16 * '0'}-worlds-2"
    assert generation_tokens({"worldCount": {}}, "own") == ["own"]


def test_a_later_job_has_no_token_that_another_document_may_have():
    section: JsonValue = {"worldCount": {"floorplanCount": 100}}
    assert not {*generation_tokens(section, "night")} & {*generation_tokens(section, "night-2")}
    assert generation_tokens(section, "night")[1] != "night-2"


def test_long_tokens_that_differ_at_their_ends_alone_share_no_job():
    section: JsonValue = {"worldCount": {"floorplanCount": 600}}
    one, other = (generation_tokens(section, "t" * 63 + end) for end in "ab")
    assert not {*one} & {*other}
    assert len({*one, *other}) == 24
    assert max(map(len, one + other)) == 64
