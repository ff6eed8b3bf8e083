"""Worlds survive the way to bytes and back exactly."""

import hashlib
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.base import canonical_json
from specs.data.world import Furniture, World
from specs.errors import DocumentError, ObjectExists, ResourceNotFound, WorldChanged
from specs.template.body import TemplateBody
from tasks.storage.base.store import Store
from tasks.storage.worlds import decode_world, encode_world, pinned_world_bytes, read_world, write_world
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


@settings(max_examples=8, deadline=None)
@given(templates(), st.text(max_size=8), st.tuples(*[st.floats(-9.0, 9.0)] * 3))
def test_a_world_is_written_as_canonical_json_writes_any_document(
    body: TemplateBody, name: str, center_m: tuple[float, float, float]
) -> None:
    world = make(body)
    solid = world.walls[0].model_copy(update={"name": name, "center_m": center_m})
    piece = Furniture(name=name, model_type=name, room=name, center_m=(1e-9, 1e17), yaw_rad=-0.0, solids=(solid,))
    world = world.model_copy(update={"walls": (solid,), "furniture": (*world.furniture, piece)})
    assert encode_world(world) == canonical_json(world.model_dump(mode="json"))


@pytest.mark.parametrize("small", [0.00005, -0.000012, 1e-6, 1e-9, 1e17, -0.0])
def test_numbers_that_python_writes_with_an_exponent_are_written_so(small: float) -> None:
    world = make(sample("one-room"))
    walls = tuple(wall.model_copy(update={"center_m": (small, 1.5, 2.0), "yaw_rad": small}) for wall in world.walls)
    world = world.model_copy(update={"walls": walls})
    assert encode_world(world) == canonical_json(world.model_dump(mode="json"))


def test_a_zero_keeps_its_sign_beside_an_equal_one() -> None:
    world = make(sample("one-room"))
    colors = ((0.0, 0.1, 0.2), (-0.0, 0.1, 0.2))
    walls = tuple(world.walls[0].model_copy(update={"color": color}) for color in colors)
    world = world.model_copy(update={"walls": walls})
    assert encode_world(world) == canonical_json(world.model_dump(mode="json"))


@pytest.mark.parametrize("yaw_rad", [math.nan, math.inf])
def test_a_world_of_numbers_that_json_has_not_is_refused(yaw_rad: float) -> None:
    world = make(sample("one-room"))
    wall = world.walls[0].model_copy(update={"yaw_rad": yaw_rad})
    with pytest.raises(ValueError, match="JSON"):
        encode_world(world.model_copy(update={"walls": (wall,)}))


def test_numbers_have_at_most_six_decimals_and_no_negative_zero() -> None:
    def numbers(value: object) -> list[float]:
        if isinstance(value, float):
            return [value]
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        return [number for each in inner for number in numbers(each)]

    encoded = encode_world(make(sample("one-room")))
    assert b"-0.0," not in encoded
    assert all(round(number, 6) == number for number in numbers(json.loads(encoded)))


def test_a_world_is_written_once_and_read_by_its_reference(file_store: Store) -> None:
    world = make(sample("one-room"))
    reference = f"{world.generation}/{world.name}"
    for _ in range(2):
        write_world(file_store, reference, encode_world(world))
    assert read_world(file_store, reference, "test") == world
    with pytest.raises(ObjectExists, match="something else"):
        write_world(file_store, reference, b"{}")


def test_a_pinned_world_is_refused_when_it_is_another(file_store: Store) -> None:
    write_world(file_store, "g/w", b"{}")
    assert pinned_world_bytes(file_store, "g/w", hashlib.sha256(b"{}").hexdigest()) == b"{}"
    with pytest.raises(WorldChanged):
        pinned_world_bytes(file_store, "g/w", "0" * 64)


def test_a_world_that_is_gone_or_no_world_is_a_fault_of_the_document(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound, match="simyard list worlds shows what is there"):
        read_world(file_store, "g/w", "test")
    write_world(file_store, "g/w", b"{}")
    with pytest.raises(DocumentError, match="this version of Simyard wrote"):
        read_world(file_store, "g/w", "test")
    with pytest.raises(DocumentError):
        read_world(file_store, "no reference", "test")
