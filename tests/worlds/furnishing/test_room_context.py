"""Sizes and clearances suit the room."""

import numpy as np
import pytest

from tasks.worlds.furnishing.groups import RoomContext
from tasks.worlds.furnishing.scene import open_scene
from tasks.worlds.furniture.catalogue import CATALOGUE
from tests.worlds.rooms import ROBOT_M, empty_scene
from tests.worlds.templates import MODEL_TYPES


def setting(
    seed: int = 1, width_m: float = 5.0, listed: tuple[str, ...] | None = None, radius_m: float = ROBOT_M
) -> RoomContext:
    scene = open_scene(empty_scene(width_m, 4.0).floor, (), radius_m)
    return RoomContext(np.random.default_rng(seed), "Living", scene, listed, 5.0)


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_sizes_are_those_of_the_catalogue(kind: str) -> None:
    for seed in range(10):
        drawn = setting(seed)
        for size in (drawn.size(kind), *drawn.sizes(kind), drawn.smallest(kind)):
            assert CATALOGUE[kind].holds(size)


def test_sizes_to_try_become_smaller() -> None:
    for seed in range(10):
        widths = [size[0] for size in setting(seed, width_m=7.0).sizes("Sofas")]
        assert widths == sorted(widths, reverse=True)


def test_a_room_without_a_list_allows_everything() -> None:
    assert setting().allows("Baths")
    assert not setting(listed=("Beds",)).allows("Baths")


def test_what_people_pass_a_large_robot_passes_too() -> None:
    assert setting(radius_m=0.25).front_m("Sofas") == CATALOGUE["Sofas"].front_m
    assert setting(radius_m=0.45).front_m("Sofas") >= 2 * 0.45
    assert setting(radius_m=0.45).front_m("Nightstands") == CATALOGUE["Nightstands"].front_m
