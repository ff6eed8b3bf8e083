"""What the lidar can see of a world."""

import math

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import World
from tasks.simulate.geometry.lidar_scan import (
    HostLidarOutlines,
    LidarOutlines,
    lidar_outlines,
    pad_lidar_outlines,
    scan_ranges,
    within_range,
)
from tasks.simulate.geometry.obstacles import PARKING_M, Obstacles, edge_counts, obstacles
from tasks.simulate.sensors.lidar import Lidar, ray_angles
from tests.factories.planar import prism
from tests.factories.simulations import COURIER, FAULTY, FOLDERS, cluttered, convex, pen, with_prisms, with_wedges
from tests.simulate.reference import reference_model, reference_ranges


def box(x: float, half_x: float, half_y: float, yaw_rad: float) -> tuple[float, ...]:
    return (x, 0.0, 0.5, half_x, half_y, 0.5, np.cos(yaw_rad), np.sin(yaw_rad))


NO_PRISMS = np.zeros((0, 20), np.float32)


def seen(*boxes: tuple[float, ...]) -> Obstacles:
    return Obstacles(np.array(boxes, np.float32), np.array([(7.0, 8.0, 0.5, 0.3, 0.5)], np.float32), NO_PRISMS)


@pytest.mark.parametrize(
    ("yaw_rad", "half"),
    [(0.0, (0.4, 0.1)), (np.pi, (0.4, 0.1)), (np.pi / 2, (0.1, 0.4)), (-np.pi / 2, (0.1, 0.4))],
)
def test_a_quarter_turn_leaves_a_box_upright(yaw_rad: float, half: tuple[float, float]):
    found = lidar_outlines(seen(box(1.0, 0.4, 0.1, yaw_rad)))
    np.testing.assert_allclose(found.upright, np.array([(1.0, 0.0, *half)]), atol=1e-6)
    assert found.counts.tolist() == [1, 0, 1, 0, 0, 0]


def test_a_little_turn_does_not():
    found = lidar_outlines(seen(box(1.0, 0.4, 0.1, 1e-4), box(2.0, 0.4, 0.1, np.pi / 2 + 1e-4)))
    assert found.counts.tolist() == [0, 2, 1, 0, 0, 0]
    np.testing.assert_allclose(found.turned[0], (1.0, 0.0, 0.4, 0.1, 1.0, 1e-4), atol=1e-6)


def test_circles_keep_place_and_radius():
    np.testing.assert_allclose(lidar_outlines(seen(box(1.0, 0.4, 0.1, 0.0))).circles, np.array([(7.0, 8.0, 0.3)]))


def test_worlds_are_padded_to_the_same_sizes_with_what_nobody_sees():
    one, two = lidar_outlines(seen(box(1.0, 0.4, 0.1, 0.0))), lidar_outlines(seen(*[box(1.0, 0.4, 0.1, 0.3)] * 65))
    first, second = pad_lidar_outlines([one, two])
    assert [len(each) for each in first[:6]] == [len(each) for each in second[:6]] == [256, 128, 64, 0, 0, 0]
    np.testing.assert_array_equal(first.upright[:1], one.upright)
    assert (first.upright[1:, :2] == PARKING_M).all()
    assert (first.turned[:, 4] == 1.0).all()


WORLD = pen(6.0, 1)


def on_device(seen: HostLidarOutlines) -> LidarOutlines:
    return LidarOutlines(*map(jnp.asarray, seen), within=None)


SEEN = on_device(pad_lidar_outlines([lidar_outlines(obstacles(WORLD, 0.199, 0.201))])[0])


_TURNS = [np.array([0.0, 0.0, turn]) for turn in (-2e-5, 0.0, 2e-5)]
LIDAR = Lidar(rays=32, range_m=10.0, height_m=0.2)
ANGLES = ray_angles(LIDAR)
SCAN = jax.jit(lambda pose: scan_ranges(SEEN, pose, ANGLES, LIDAR.range_m))
SCAN_ONE = jax.jit(lambda seen, pose: scan_ranges(seen, pose, ANGLES, LIDAR.range_m))
SCAN_LANES = jax.jit(jax.vmap(lambda seen, pose: scan_ranges(seen, pose, ANGLES, LIDAR.range_m)))


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return reference_model(FOLDERS[COURIER] / "robot.xml", WORLD)


def test_rays_have_the_same_bits_on_processors_whose_numpy_has_other_sines():
    consts = jax.make_jaxpr(lambda pose: scan_ranges(SEEN, pose, ANGLES, LIDAR.range_m))(jnp.zeros(3)).consts
    (rays,) = (np.asarray(const) for const in consts if np.shape(const) == (2, LIDAR.rays))
    exact = [[turned(float(angle)) for angle in ANGLES] for turned in (math.cos, math.sin)]
    assert rays.tolist() == np.array(exact, np.float32).tolist()


@pytest.mark.parametrize(
    "world", [WORLD, cluttered(2), with_wedges(WORLD, 2)], ids=["pen", "apartment", "pen of prisms"]
)
def test_every_range_agrees_with_mujocos_within_a_millimetre(world: World):
    """A ray that passes an edge by a hair's breadth may see either side of it: a beam of 0.002 degrees decides."""
    model = reference_model(FOLDERS[COURIER] / "robot.xml", world)
    seen = on_device(pad_lidar_outlines([lidar_outlines(obstacles(world, 0.199, 0.201))])[0])
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(-0.7, 0.7, (100, 2)), rng.uniform(-np.pi, np.pi, 100)]).astype(np.float32)
    ours = np.asarray(jax.vmap(lambda pose: scan_ranges(seen, pose, ANGLES, LIDAR.range_m))(jnp.asarray(poses)))
    theirs = np.stack(
        [[reference_ranges(model, LIDAR, pose.astype(np.float64) + turn) for pose in poses] for turn in _TURNS]
    )
    assert (theirs < 9.9).mean() > 0.9
    assert (ours > theirs.min(axis=0) - 1e-3).all()
    assert (ours < theirs.max(axis=0) + 1e-3).all()
    assert np.quantile(np.abs(ours - theirs[1]), 0.99) < 2e-5


def test_a_box_written_as_a_prism_looks_the_same():
    boxes, prisms = (
        on_device(pad_lidar_outlines([lidar_outlines(obstacles(world, 0.199, 0.201))])[0])
        for world in (cluttered(2), with_prisms(cluttered(2)))
    )
    assert prisms.counts.tolist() == [0, 0, int(boxes.counts[2]), int(boxes.counts[:2].sum()), 0, 0]
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform(-0.7, 0.7, (200, 2)), rng.uniform(-np.pi, np.pi, 200)]).astype(np.float32)
    ours, theirs = (np.asarray(SCAN_LANES(each, poses)) for each in (many(boxes), many(prisms)))
    # A ray that passes a corner by a hair's breadth may see either side of it.
    off = np.abs(ours - theirs)
    assert (off > 1e-5).mean() < 1e-3
    assert np.quantile(off, 0.99) < 2e-6


@pytest.mark.parametrize("yaw_rad", [5e-10, -5e-10, 0.0])
def test_a_ray_along_an_edge_meets_what_is_ahead_and_nothing_beside(yaw_rad: float):
    """A robot that goes along an axis turns by ever less: its rays are then nearly, but not quite, along edges."""
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])

    def ahead_m(*places: tuple[float, float]) -> float:
        rows = np.array([prism(x, y, square) for x, y in places], np.float32)
        none = np.zeros((0, 8), np.float32), np.zeros((0, 5), np.float32)
        world = on_device(pad_lidar_outlines([lidar_outlines(Obstacles(*none, rows))])[0])
        return float(SCAN_ONE(world, jnp.array([0.0, 0.0, yaw_rad]))[0])

    assert ahead_m((2.0, 2.0), (2.0, -2.0)) == LIDAR.range_m
    assert ahead_m((2.0, 2.0), (2.0, -2.0), (4.0, 0.0)) == 3.5


def many(seen: LidarOutlines) -> LidarOutlines:
    return jax.tree.map(lambda each: jnp.broadcast_to(each, (200, *each.shape)), seen)


def of_corners(*counts: int) -> HostLidarOutlines:
    """Returns prisms of so many corners, around the origin, 3 m from it."""
    turns = np.linspace(0.0, 2 * np.pi, len(counts), endpoint=False)
    rows = [
        prism(3.0 * np.cos(turn), 3.0 * np.sin(turn), regular(corners))
        for turn, corners in zip(turns, counts, strict=True)
    ]
    none = np.zeros((0, 8), np.float32), np.zeros((0, 5), np.float32)
    return lidar_outlines(Obstacles(*none, np.array(rows, np.float32)))


def regular(corners: int) -> np.ndarray:
    turns = 2 * np.pi * np.arange(corners) / corners
    return 0.4 * np.stack([np.cos(turns), np.sin(turns)], axis=1)


def test_prisms_are_kept_by_the_most_edges_that_they_may_have():
    found = of_corners(8, 4, 6, 3, 5, 7)
    assert found.counts.tolist() == [0, 0, 0, 2, 2, 2]
    kept = [len(np.unique(row[2:].reshape(-1, 2), axis=0)) for kind in found[3:6] for row in kind]
    assert kept == [4, 3, 6, 5, 8, 7]


def test_a_lane_sees_its_prisms_in_the_same_bits_whatever_edges_the_others_have():
    few, many_edges, mixed = (
        of_corners(4, 3, 4, 4, 4, 4, 4, 4, 3),
        of_corners(*[8] * 13),
        of_corners(3, 8, 5, 6, 4, 7, 8),
    )
    seen = pad_lidar_outlines([few, many_edges, mixed])
    pose = jnp.array([0.3, -0.2, 0.4])
    alone = [np.asarray(SCAN_LANES(stacked([each]), pose[None]))[0] for each in seen]
    together = np.asarray(SCAN_LANES(stacked(seen), jnp.tile(pose, (3, 1))))
    assert (together < LIDAR.range_m).any(axis=1).all()
    np.testing.assert_array_equal(together, alone)


def test_a_lidar_sees_the_same_in_the_same_bits_of_what_is_near():
    """Also where it is not in the slice any more for which that was picked out: it looks at everything then."""
    rng = np.random.default_rng(5)
    rows = [prism(x, y, convex(rng, 0.5)) for x, y in rng.uniform(-30.0, 30.0, (600, 2))]
    boxes = [(x, y, 0.5, 0.3, 0.2, 0.5, np.cos(turn), np.sin(turn)) for x, y, turn in rng.uniform(-30.0, 30.0, (90, 3))]
    world = Obstacles(*(np.array(kind, np.float32) for kind in (boxes, [(7.0, 8.0, 0.5, 0.3, 0.5)], rows)))
    every = on_device(pad_lidar_outlines([lidar_outlines(world)])[0])
    near = within_range(every, jnp.array([3.0, -2.0]), LIDAR.range_m)
    assert near.within is not None
    assert 0 < near.within.counts.sum() < 0.3 * every.counts.sum()
    poses = jnp.array([[3.0, -2.0, 0.3], [3.6, -2.7, 2.0], [-20.0, 21.0, 1.0], [4.0, -2.0, -1.0]])
    ours, theirs = (np.asarray([SCAN_ONE(seen, pose) for pose in poses]) for seen in (near, every))
    assert ((theirs < LIDAR.range_m).mean(axis=1) > 0.1).all()
    np.testing.assert_array_equal(ours, theirs)


def test_a_lidar_sees_the_same_of_what_is_near_in_a_large_world_without_prisms():
    rng = np.random.default_rng(6)
    boxes = [(x, y, 0.5, 0.3, 0.2, 0.5, 1.0, 0.0) for x, y in rng.uniform(-30.0, 30.0, (400, 2))]
    world = Obstacles(
        *(np.array(kind, np.float32).reshape(-1, width) for kind, width in ((boxes, 8), ([], 5), ([], 20)))
    )
    every = on_device(pad_lidar_outlines([lidar_outlines(world)])[0])
    near = within_range(every, jnp.array([3.0, -2.0]), LIDAR.range_m)
    assert near.within is not None
    assert 0 < near.within.counts.sum() < 0.3 * every.counts.sum()
    pose = jnp.array([3.0, -2.0, 0.3])
    assert (np.asarray(SCAN_ONE(every, pose)) < LIDAR.range_m).any()
    np.testing.assert_array_equal(SCAN_ONE(near, pose), SCAN_ONE(every, pose))


def test_a_small_world_is_looked_at_as_it_lies():
    assert within_range(SEEN, jnp.zeros(2), 0.1) is SEEN


def stacked(seen: list[HostLidarOutlines]) -> LidarOutlines:
    return LidarOutlines(*(jnp.asarray(np.stack(each)) for each in zip(*seen, strict=True)), within=None)


@pytest.mark.long
def test_rays_meet_ten_thousand_prisms_where_their_edges_are():
    """From outside and from inside: each edge is a segment, and the first one whose front a ray crosses counts."""
    rng = np.random.default_rng(4)
    outlines = [convex(rng, 1.0) for _ in range(10_000)]
    rows = np.array(
        [prism(x, y, corners) for (x, y), corners in zip(rng.uniform(-2.0, 2.0, (10_000, 2)), outlines, strict=True)],
        np.float32,
    )
    rows = rows[np.argsort(np.searchsorted((4, 6, 8), edge_counts(rows)), kind="stable")]  # as the lidar sorts them
    seen = lidar_outlines(Obstacles(np.zeros((0, 8), np.float32), np.zeros((0, 5), np.float32), rows))
    # Each alone in its world, in the kind that is its own.
    places = np.split(np.arange(10_000), np.cumsum(seen.counts[3:5]))
    lone = [np.zeros((10_000, 8, kind.shape[1]), np.float32) for kind in seen[:6]]
    counts = np.zeros((10_000, 6), np.int32)
    for place, (rows_of_kind, kind) in enumerate(zip(places, seen[3:6], strict=True), 3):
        lone[place][rows_of_kind], counts[rows_of_kind, place] = kind[:, None], 1
    lone = LidarOutlines(*map(jnp.asarray, (*lone, counts)), within=None)
    poses = rng.uniform(-2.0, 2.0, (10_000, 3)).astype(np.float32)
    ranges = np.asarray(SCAN_LANES(lone, poses))
    corners = rows[:, None, :2].astype(np.float64) + rows[:, 4:].reshape(-1, 8, 2)
    expected = crossed_m(corners, poses.astype(np.float64), ANGLES.astype(np.float64))
    assert 0.05 < (expected < LIDAR.range_m).mean() < 0.5
    off = np.abs(ranges - expected)
    # Grazing rays: an edge that is nearly along one, or a corner beside it.
    assert (off > 1e-4).mean() < 2e-4
    assert np.quantile(off, 0.999) < 2e-5


def crossed_m(corners: np.ndarray, poses: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Returns how far each ray goes until it crosses one of the edges from its right to its left, (prisms, rays)."""
    turn = poses[:, 2, None] + angles
    ray = np.stack([np.cos(turn), np.sin(turn)], axis=-1)[:, :, None]
    begin, along = corners - poses[:, None, :2], np.roll(corners, -1, axis=1) - corners
    begin, along = begin[:, None], along[:, None]
    facing = along[..., 0] * ray[..., 1] - along[..., 1] * ray[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        at_m = (begin[..., 1] * along[..., 0] - begin[..., 0] * along[..., 1]) / facing
        share = (begin[..., 1] * ray[..., 0] - begin[..., 0] * ray[..., 1]) / facing
    met = (facing > 0.0) & (share >= 0.0) & (share <= 1.0) & (at_m >= 0.0)
    return np.minimum(np.where(met, at_m, np.inf).min(axis=2), LIDAR.range_m)


@settings(max_examples=30, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.integers(0, 31))
def test_turning_by_a_ray_shifts_the_ranges_by_one(x: float, y: float, ray: int):
    step = 2 * np.pi / 32
    ahead = np.asarray(SCAN(jnp.array([x, y, 0.0])))
    turned = np.asarray(SCAN(jnp.array([x, y, ray * step])))
    assert np.mean(np.abs(np.roll(ahead, -ray) - turned) > 1e-3) <= 2 / 32


def test_nothing_near_gives_the_range():
    nothing = on_device(pad_lidar_outlines([lidar_outlines(obstacles(WORLD, 5.0, 6.0))])[0])
    ranges = scan_ranges(nothing, jnp.zeros(3), ANGLES, 7.5)
    np.testing.assert_array_equal(ranges, np.full(32, 7.5, np.float32))


def test_the_reference_sees_no_part_of_the_robot(model: mujoco.MjModel):
    alone = reference_model(FOLDERS[FAULTY] / "robot.xml", WORLD.model_copy(update={"walls": (), "furniture": ()}))
    assert (reference_ranges(alone, LIDAR, np.zeros(3)) == 10.0).all()


def test_each_lane_sees_its_own_world_whatever_is_in_the_others():
    worlds = [pen(6.0, seed) for seed in range(8)]
    worlds[3] = worlds[3].model_copy(update={"furniture": ()})
    seen = pad_lidar_outlines([lidar_outlines(obstacles(world, 0.199, 0.201)) for world in worlds])
    poses = np.random.default_rng(1).uniform(-1.2, 1.2, (8, 3)).astype(np.float32)
    together = SCAN_LANES(stacked(seen), poses)
    for ranges, each, pose in zip(together, seen, poses, strict=True):
        np.testing.assert_allclose(ranges, scan_ranges(on_device(each), jnp.asarray(pose), ANGLES, 10.0), atol=1e-5)
    assert len({float(ranges.sum()) for ranges in together}) == 8


def test_padding_is_not_looked_at():
    beyond = jnp.arange(256)[:, None] >= SEEN.counts[0] + 8
    spoiled = SEEN._replace(upright=jnp.where(beyond, 0.01, SEEN.upright))
    np.testing.assert_array_equal(scan_ranges(spoiled, jnp.zeros(3), ANGLES, 10.0), SCAN(jnp.zeros(3)))


def test_a_field_of_view_is_swept_from_right_to_left():
    lidar = Lidar(rays=5, range_m=10.0, height_m=0.2, fov_rad=np.pi)
    np.testing.assert_allclose(ray_angles(lidar), np.radians([-90, -45, 0, 45, 90]), atol=1e-6)
    np.testing.assert_array_equal(ray_angles(lidar._replace(rays=1)), [0.0])
