"""The nearest of a robot's neighbours are the nearest of all, and a step among few has the bits of one among all."""

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import World
from tasks.simulate.application.contract import Body, Motion
from tasks.simulate.chunk.chunk_simulation import ready_chunk
from tasks.simulate.engines.compiled_program import CompiledRun, compiled_program
from tasks.simulate.engines.planar.near_obstacles import (
    Nearest,
    Neighbours,
    among_fewest,
    few_counts,
    nearest,
    neighbours,
    obstacles_needed,
)
from tasks.simulate.engines.planar.planar_algebra import Planar
from tasks.simulate.engines.planar.planar_engine import drive_among, first_body
from tasks.simulate.engines.planar.planar_robot import planar_robot
from tasks.simulate.geometry.hull_distance import LaneObstacles
from tasks.simulate.geometry.obstacles import PRISM_COLUMNS, Obstacles, pad_obstacles
from tests.factories.planar import CAPSULE, DRUM, ROUGH, Parts, box, on_device, prism, write_robot
from tests.factories.simulations import FOLDERS, convex, pushing
from tests.simulate.conftest import PUSHER_LANES

COUNT, LANES, REACH_M = 6, 8, 0.8
_MOST = 300


def strewn(seed: int, density: float, half_m: float, count: int, *, prisms: bool = False) -> Obstacles:
    """Returns boxes, turned boxes and posts, some in the same place: as many a square metre, as large as told.

    And prisms, if they are asked for.
    """
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.5, 0.5, (count, 2)) * np.sqrt(count / density)
    # Of equal distances the first in order counts.
    places[1 : count // 4 : 2] = places[0 : count // 4 - 1 : 2]
    halves = rng.uniform(0.2, 1.0, (count, 2)) * half_m
    halves[1 : count // 4 : 2] = halves[0 : count // 4 - 1 : 2]
    yaws = np.where(np.arange(count) % 3 == 2, rng.uniform(-2.0, 2.0, count), 0.0)
    columns = [*places.T, np.full(count, 0.5), *halves.T, np.full(count, 0.5), np.cos(yaws), np.sin(yaws)]
    boxes = np.stack(columns, axis=1).astype(np.float32)
    posts = boxes[count // 2 :: 3, [0, 1, 2, 3, 5]]
    wedges = [prism(x, y, convex(rng, half_m)) for x, y in places[:: 2 if prisms else count]][not prisms :]
    return pad_obstacles(
        [Obstacles(boxes[: count // 2], posts, np.array(wedges, np.float32).reshape(-1, PRISM_COLUMNS))]
    )[0]


def in_lanes(function: Callable[..., Nearest]) -> Callable[..., Nearest]:
    return jax.jit(jax.vmap(function, in_axes=(None, 0, 0)))


PICK = jax.jit(jax.vmap(lambda obstacles, m: neighbours(obstacles, m, COUNT), in_axes=(None, 0)))
OF_ALL = in_lanes(lambda obstacles, m, _: nearest(obstacles, m, COUNT, None))
OF_PICKED = in_lanes(lambda obstacles, m, near: nearest(obstacles, m, COUNT, near))


class Strewn(NamedTuple):
    """What a world is strewn with, and how far from the origin."""

    seed: int
    density: float
    half_m: float
    solids: int
    far_m: float
    prisms: bool

    def arrays(self) -> LaneObstacles:
        return shifted(strewn(*self[:4], prisms=self.prisms), self.far_m)


WORLDS = st.builds(
    Strewn,
    st.integers(0, 1000),
    st.sampled_from([0.05, 0.3, 1.0, 3.0, 30.0]),
    st.sampled_from([0.01, 0.3, 5.0]),
    st.sampled_from([8, 40, 120, _MOST]),
    st.sampled_from([0.0, 50.0, 3000.0]),
    st.booleans(),
)


def lanes_about(seed: int, extent_m: float, far_m: float, away_m: float) -> tuple[jax.Array, jax.Array]:
    """Returns where lanes stood, and where they are: so far off at most, a lane exactly so far."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform(-extent_m, extent_m, (LANES, 2))
    centers[:, 0] += far_m
    turns, ways = rng.uniform(-np.pi, np.pi, LANES), away_m * np.sqrt(rng.uniform(0.0, 1.0, LANES))
    ways[0] = away_m
    moved = centers + ways[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return jnp.asarray(centers, jnp.float32), jnp.asarray(moved, jnp.float32)


def assert_equal(one: Nearest, other: Nearest) -> None:
    jax.tree.map(np.testing.assert_array_equal, one, other)


def shifted(world: Obstacles, by_m: float) -> LaneObstacles:
    return LaneObstacles(*(jnp.asarray(kind).at[:, 0].add(by_m) for kind in world))


@settings(max_examples=150, deadline=None)
@given(WORLDS, st.sampled_from([0.0, 0.5, 1.0]))
def test_within_its_disc_a_robot_has_the_nearest_of_all(world: Strewn, share: float):
    around = world.arrays()
    centers, moved = lanes_about(world.seed, 4.0, world.far_m, share)
    picked = PICK(around, centers)
    radii_m = np.maximum(np.asarray(picked.radius_m), 0.0)
    points = centers + (moved - centers) * 0.999 * radii_m[:, None]
    assert_equal(OF_PICKED(around, points, picked), OF_ALL(around, points, picked))


@settings(max_examples=50, deadline=None)
@given(WORLDS, st.sampled_from([0.81, 1.0, 5.0, 1e4, 1e30, np.nan]))
def test_a_robot_that_has_left_its_disc_has_the_nearest_of_all(world: Strewn, away_m: float):
    around = world.arrays()
    centers, moved = lanes_about(world.seed, 4.0, world.far_m, away_m)
    picked = PICK(around, centers)
    assert_equal(OF_PICKED(around, moved, picked), OF_ALL(around, moved, picked))


def test_a_point_that_is_no_number_has_no_disc():
    around = shifted(strewn(0, 1.0, 0.3, 40), 0.0)
    nowhere = jnp.full((LANES, 2), jnp.nan)
    picked = PICK(around, nowhere)
    points = jnp.zeros((LANES, 2))
    assert_equal(OF_PICKED(around, points, picked), OF_ALL(around, points, picked))


def test_in_clutter_a_disc_is_smaller_and_in_a_heap_there_is_none():
    radii_m = [
        float(PICK(shifted(strewn(1, density, 0.05, _MOST), 0.0), jnp.zeros((LANES, 2))).radius_m[0])
        for density in (1.0, 12.0, 1000.0)
    ]
    assert radii_m[0] == pytest.approx(REACH_M)
    assert radii_m[0] > radii_m[1] > 0.0 > radii_m[2]


def test_one_lane_that_left_changes_no_other():
    around = shifted(strewn(2, 1.0, 0.3, 120), 0.0)
    centers, moved = lanes_about(2, 4.0, 0.0, 0.7)
    picked = PICK(around, centers)
    together, gone = (OF_PICKED(around, at, picked) for at in (moved, moved.at[5, 0].add(3.0)))
    others = np.arange(LANES) != 5
    assert_equal(*(jax.tree.map(lambda array: array[others], each) for each in (together, gone)))


def test_a_robot_with_fewer_obstacles_than_it_asks_for_has_them_all():
    around = LaneObstacles(*(each[:2] for each in shifted(strewn(3, 1.0, 0.3, 40), 0.0)))
    points = jnp.zeros((LANES, 2))
    picked: Neighbours = PICK(around, points)
    found = OF_PICKED(around, points, picked)
    assert found.round.shape == (LANES, 4)
    assert_equal(found, OF_ALL(around, points, picked))


def test_specks_that_fill_a_world_up_change_no_order():
    rng = np.random.default_rng(4)
    turns, apart_m = np.linspace(-np.pi, np.pi, 100), 1.0 + rng.uniform(0.0, 2e-3, 100)
    boxes = np.tile(np.array([0.0, 0.0, 0.5, 0.05, 0.05, 0.5, 1.0, 0.0], np.float32), (100, 1))
    boxes[:, 0], boxes[:, 1] = apart_m * np.cos(turns), apart_m * np.sin(turns)
    nothing = np.zeros((0, PRISM_COLUMNS), np.float32)
    ring = Obstacles(boxes[::2], boxes[1::2, [0, 1, 2, 3, 5]], nothing)
    many = Obstacles(np.tile(boxes, (4, 1)), boxes[:0, :5], nothing)
    small, large = pad_obstacles([ring])[0], pad_obstacles([ring, many])[0]
    assert len(large.boxes) > 2 * len(small.boxes)
    points = jnp.asarray(rng.uniform(-1e-3, 1e-3, (LANES, 2)), jnp.float32)
    found = [OF_ALL(shifted(each, 0.0), points, None) for each in (small, large)]
    assert_equal(found[0], found[1])


@pytest.mark.long
def test_episodes_have_the_same_bits_as_when_all_obstacles_are_looked_at(pens: dict[str, World]):
    requests = [pushing(k, world=f"hand/pen-{k % 2}", seed=k, duration_s=10.0) for k in range(PUSHER_LANES)]
    run = ready_chunk(requests, pens, FOLDERS, lanes=PUSHER_LANES, engine="planar").run
    assert isinstance(run, CompiledRun)
    mechanics = replace(run.program.mechanics, near=lambda *_: None)
    plain = CompiledRun(compiled_program(mechanics, run.program.applications, PUSHER_LANES), run.inputs)
    states = [each.begin() for each in (run, plain)]
    for _ in range(8):
        (states[0], record), (states[1], other) = run.advance(states[0]), plain.advance(states[1])
        jax.tree.map(np.testing.assert_array_equal, (states[0], record), (states[1], other))
    assert (np.asarray(states[0].totals.collisions) > 0).any()


BUMPING_LANES, STEPS = 16, 40
ARM = '<geom type="sphere" size="0.06" pos="0.3 0.1 0" mass="0.1"/>'


def nearest_free(free_m: list[float], moved_m: float, acceleration: float = 1.0) -> int:
    moved = Planar(jnp.float32(moved_m), jnp.float32(0.0), jnp.float32(0.0))
    before = Planar(jnp.float32(1.0), jnp.float32(acceleration), jnp.float32(1.0))
    return int(obstacles_needed([jnp.float32(each) for each in free_m], moved, before))


def test_the_lane_that_needs_most_decides_for_all():
    among = among_fewest(lambda count, given: given + count, (0, 2, 6))
    mapped = jax.vmap(among)

    assert mapped(jnp.array([0, 0]), jnp.zeros(2)).tolist() == [0, 0]
    assert mapped(jnp.array([0, 1]), jnp.zeros(2)).tolist() == [2, 2]
    assert mapped(jnp.array([3, 1]), jnp.zeros(2)).tolist() == [6, 6]
    assert among(jnp.int32(1), jnp.float32(0.0)) == 2


@pytest.mark.parametrize(("isa", "counts"), [("AVX", (0, 1, 3, 6)), ("AVX2", (6,))])
def test_where_products_and_sums_may_be_fused_work_is_done_among_all(
    monkeypatch: pytest.MonkeyPatch, isa: str, counts: tuple[int, ...]
):
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    monkeypatch.setenv("XLA_FLAGS", f"--xla_cpu_max_isa={isa}")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    assert few_counts(6) == counts


def test_obstacles_beyond_the_last_that_can_be_touched_are_not_needed():
    assert nearest_free([0.3, 0.4], 0.1) == 0
    assert nearest_free([0.0, 0.4, 0.4], 0.1) == 1
    # The window's order is that of rounded distances.
    assert nearest_free([0.4, 0.05, 0.4], 0.1) == 2


@pytest.mark.parametrize(("moved_m", "acceleration"), [(np.nan, 1.0), (0.1, -0.0)])
def test_all_obstacles_are_needed_where_one_more_could_change_a_bit(moved_m: float, acceleration: float):
    assert nearest_free([0.4, 0.4], moved_m, acceleration) == 2


@pytest.mark.parametrize(
    "parts",
    [
        pytest.param({}, id="ball", marks=pytest.mark.long),
        pytest.param(ROUGH, id="rough", marks=pytest.mark.soak),
        pytest.param(DRUM, id="drum", marks=pytest.mark.soak),
        pytest.param(CAPSULE, id="capsule", marks=pytest.mark.soak),
        pytest.param({"more": ARM}, id="arm", marks=pytest.mark.long),
    ],
)
def test_a_step_among_few_has_the_bits_of_a_step_among_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parts: Parts
):
    path = write_robot(tmp_path, parts)
    few = bumping(path)
    monkeypatch.setattr("tasks.simulate.engines.planar.near_obstacles.FEW", ())
    among_all = bumping(path)

    for one, other in zip(jax.tree.leaves(few), jax.tree.leaves(among_all), strict=True):
        assert one.tobytes() == other.tobytes()
    touching = np.asarray(few.work.impulse_ns) > 0.0
    assert 0.0 < touching.mean() < 0.9


def bumping(path: Path) -> Motion:
    """Returns what becomes of robots among obstacles, some of which stand still: (steps, lanes, ...), traced anew."""
    robot, rng = planar_robot(path), np.random.default_rng(3)
    boxes = [[box(x, y, 0.1, 0.2, yaw=yaw) for x, y, yaw in each] for each in rng.uniform(-2, 2, (BUMPING_LANES, 9, 3))]
    posts = [[[x, y, 0.5, 0.1, 0.5] for x, y in each] for each in rng.uniform(-2, 2, (BUMPING_LANES, 3, 2))]
    around = on_device((np.array(boxes), np.array(posts), np.zeros((BUMPING_LANES, 0, PRISM_COLUMNS))))
    starts = rng.uniform(-2, 2, (BUMPING_LANES, 3))
    controls = np.repeat(rng.uniform(-1, 1, (STEPS // 10, BUMPING_LANES, 3)), 10, axis=0)
    controls[:, ::4] = 0.0
    step = jax.vmap(functools.partial(drive_among, robot))

    def advance(body: Body, control: jax.Array) -> tuple[Body, Motion]:
        motion = step(around, body, control)
        return motion.body, motion

    begin = jax.vmap(functools.partial(first_body, robot))(jnp.asarray(starts, jnp.float32))
    drive = jax.jit(lambda begin, controls: jax.lax.scan(advance, begin, controls)[1])
    return jax.device_get(drive(begin, jnp.asarray(controls, jnp.float32)))
