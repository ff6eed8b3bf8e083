"""Worlds survive the way to bytes and back exactly."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import World
from specs.template.body import TemplateBody
from tasks.storage.worlds import decode_world, encode_world
from tasks.worlds.generate import generate_world
from tests.worlds.templates import sample, templates


def make(body: TemplateBody, seed: int = 1) -> World:
    return generate_world(body, seed=seed, generation="wgj-1", floorplan_index=1, interior_index=1)


@settings(max_examples=8, deadline=None)
@given(templates(), st.integers(0, 100))
def test_decoding_the_bytes_gives_the_same_world_and_bytes(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    encoded = encode_world(world)
    assert decode_world(encoded) == world
    assert encode_world(decode_world(encoded)) == encoded


def test_the_bytes_are_sorted_json_without_spaces() -> None:
    encoded = encode_world(make(sample("two-rooms")))
    document = json.loads(encoded)
    assert encoded == json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def test_numbers_have_at_most_six_decimals_and_no_negative_zero() -> None:
    def numbers(value: object) -> list[float]:
        if isinstance(value, float):
            return [value]
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        return [number for each in inner for number in numbers(each)]

    encoded = encode_world(make(sample("one-room")))
    assert b"-0.0," not in encoded
    assert all(round(number, 6) == number for number in numbers(json.loads(encoded)))
