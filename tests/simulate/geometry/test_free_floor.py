"""What cells settle is what measuring finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import solids
from tasks.simulate.geometry import free_floor as cells
from tasks.simulate.geometry.free_floor import OpenFloor, clearance_m, has_room, is_free, is_open, open_floor, solids_of
from tasks.simulate.geometry.obstacles import obstacles
from tests.factories.simulations import cluttered, pen, with_wedges
from tests.worlds.geometry_checks import distances


def floor_of(seed: int, radius_m: float) -> OpenFloor:
    world = pen(4.5, seed) if seed % 2 else cluttered(seed)
    world = with_wedges(world, seed) if seed % 3 else world
    return open_floor(solids_of(obstacles(world, 0.02, 0.38)), radius_m)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.03, 0.2, 0.45]))
def test_places_and_lines_are_those_that_measuring_finds_free(seed: int, radius_m: float):
    floor = floor_of(seed, radius_m)
    places = np.random.default_rng(seed).uniform(-4.0, 9.0, (400, 2))
    room = has_room(floor, places)
    assert room.tolist() == (clearance_m(floor.solids, places) >= radius_m).tolist()
    starts, ends = places[room][::2], places[room][1::2]
    starts = starts[: len(ends)]
    assert is_open(floor, starts, ends).tolist() == is_free(floor.solids, starts, ends, radius_m).tolist()


def test_what_is_measured_is_the_distance_to_prisms_and_what_lines_cross():
    floor, world = floor_of(7, 0.2), with_wedges(pen(4.5, 7), 7)
    places = np.random.default_rng(3).uniform(-2.2, 2.2, (500, 2))
    apart_m = np.min([distances(solid, places) for solid in solids(world)], axis=0)
    np.testing.assert_allclose(clearance_m(floor.solids, places), apart_m, atol=1e-5)
    roomy = places[apart_m > 0.2]
    starts, ends = roomy[::2][: len(roomy) // 2], roomy[1::2]
    shares = np.linspace(0.0, 1.0, 400)[:, None, None]
    along = (starts + shares * (ends - starts)).reshape(-1, 2)
    nearest_m = np.min([distances(solid, along) for solid in solids(world)], axis=0).reshape(400, -1).min(axis=0)
    free = is_free(floor.solids, starts, ends, 0.2)
    # Two looks lie at most 1.6 cm apart.
    assert (nearest_m[free] >= 0.2 - 1e-5).all()
    assert (nearest_m[~free] < 0.2 + 0.008).all()
    assert 0.1 < free.mean() < 0.9


def test_most_is_settled_by_cells(monkeypatch: pytest.MonkeyPatch):
    floor, measured = floor_of(2, 0.2), list[int]()
    places = np.random.default_rng(0).uniform(-2.0, 6.0, (1000, 2))
    monkeypatch.setattr(
        cells, "clearance_m", lambda solids, points: measured.append(len(points)) or clearance_m(solids, points)
    )
    has_room(floor, places)
    assert 0 < sum(measured) < len(places) / 4


def test_a_floor_without_solids_has_room_everywhere():
    nothing = open_floor(solids_of(obstacles(cluttered(1), 50.0, 51.0)), 0.2)
    places = np.array([(0.0, 0.0), (3.0, 4.0)])
    assert has_room(nothing, places).all()
    assert is_open(nothing, places, places[::-1]).all()
