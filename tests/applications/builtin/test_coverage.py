"""The coverage scenario: what counts as seen, where it sends a robot, and how it judges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from applications.coverage.coverage.floor import Floor, Placement, Verdict, scenario
from applications.coverage.coverage.sight import MOST_SQUARES, packed, sights, squares_of
from applications.coverage.coverage.tour import shortened, viewpoints
from specs.data.world import Start, World
from tasks.simulate.application.contract import REASONS, HostMap, Truth
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import floor_map
from tests.applications.builtin.drives import COURIER, COVERAGE, drive
from tests.factories.simulations import cluttered, hall, pen

pytestmark = pytest.mark.long

RADIUS_M = 0.18
WORLDS = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(4)}
WORLD, BARE = WORLDS["hand/apartment-2"], hall(2.0)


def mapped(world: World) -> HostMap:
    return floor_map(world, obstacles(world, 0.02, 0.38))


def placed(world: World, seed: int = 0, range_m: float = 2.5, share: float = 0.95) -> Placement:
    return Floor(range_m, share).place(world, mapped(world), RADIUS_M, np.random.default_rng(seed))


def truth(time_s: float, x: float, y: float, *, impulse_ns: float = 0.0, inside: bool = True) -> Truth:
    place = jnp.array([x, y, 0.0])
    return Truth(
        jnp.float32(time_s), place, jnp.zeros(3), jnp.float32(0.1), jnp.float32(impulse_ns), jnp.asarray(inside)
    )


def judged(world: World, *truths: Truth, share: float = 0.95) -> tuple[Verdict, dict[str, float]]:
    begun, judge = placed(world), Floor(2.5, share)
    state = judge.init(jnp.zeros(3), jnp.asarray(begun.goals_m), *map(jnp.asarray, begun.given))
    step, verdict = jax.jit(judge.step), None
    for each in truths:
        state, verdict = step(state, each)
    assert verdict is not None
    return verdict, {name: float(value) for name, value in judge.metrics(state).items()}


def test_what_lies_behind_a_wall_is_not_seen():
    floor = mapped(WORLD)
    here, beside, behind = [2.2, -0.5], [1.6, -0.5], [2.9, -0.5]
    seen = sights(floor, np.array([here, beside, behind]), 2.5)
    np.testing.assert_array_equal(seen, [[True, True, False], [True, True, False], [False, False, True]])


def test_what_is_farther_than_the_range_is_not_seen():
    points_m = np.array([[-2.0, 0.0], [0.4, 0.0], [1.0, 0.0]])
    np.testing.assert_array_equal(sights(mapped(BARE), points_m, 2.5)[0], [True, True, False])


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 30), st.floats(0.5, 6.0))
def test_who_sees_is_seen(seed: int, range_m: float):
    floor = mapped(cluttered(seed % 4))
    rng = np.random.default_rng(seed)
    rows, columns = np.nonzero(floor.clearance_m > RADIUS_M)
    chosen = rng.integers(len(rows), size=40)
    points_m = floor.origin_m + floor.cell_m * np.stack([columns[chosen], rows[chosen]], axis=1).astype(np.float64)
    seen = sights(floor, points_m, range_m)
    np.testing.assert_array_equal(seen, seen.T)
    assert seen.diagonal().all()


def test_every_place_of_the_floor_lies_in_one_of_the_squares_and_they_are_not_too_many():
    large = floor_map(hall(12.0), obstacles(hall(12.0), 0.02, 0.38))
    for floor in (mapped(WORLD), large):
        free = floor.clearance_m >= RADIUS_M
        squares = squares_of(floor, free)
        rows, columns = np.nonzero(free)
        assert (squares.number[rows // squares.side_cells, columns // squares.side_cells] >= 0).all()
        assert 500 < len(squares.points_m) <= MOST_SQUARES


def test_sights_survive_being_packed():
    seen = np.random.default_rng(0).random((77, 77)) < 0.4
    words = packed(seen)
    assert words.nbytes == 128 * 1024
    bits = (words[:, :, None] >> np.arange(32, dtype=np.uint32)) & 1
    np.testing.assert_array_equal(bits.reshape(MOST_SQUARES, MOST_SQUARES)[:77, :77], seen)


def test_viewpoints_show_everything_and_none_is_superfluous():
    seen = np.eye(6, dtype=bool)
    seen[0, :3] = seen[4, 3:5] = True
    assert viewpoints(seen, np.ones(6, bool), 1) == [0, 4, 5]


def test_viewpoints_are_in_tight_places_only_where_they_must_be():
    seen = np.eye(4, dtype=bool)
    seen[1, 2] = seen[2, 1] = True
    assert viewpoints(seen, np.array([True, False, True, False]), 0) == [2, 3]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000))
def test_no_exchange_shortens_a_tour(seed: int):
    places = np.random.default_rng(seed).uniform(0, 10, (8, 2))
    ways = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    order = shortened(ways, np.arange(8))

    def length(order: np.ndarray) -> float:
        return float(ways[order[:-1], order[1:]].sum())

    assert order[0] == 0
    assert sorted(order) == list(range(8))
    for first in range(1, 8):
        for end in range(first + 2, 9):
            turned = np.concatenate([order[:first], order[first:end][::-1], order[end:]])
            assert length(order) <= length(turned) + 1e-6


def test_arrays_have_the_same_form_in_every_world_up_to_19_m():
    forms = [[(each.shape, each.dtype) for each in placed(world).given] for world in (WORLD, BARE, pen(16.0, 3))]
    assert forms[0] == forms[1] == forms[2]
    assert len({mapped(world).clearance_m.shape for world in (WORLD, BARE, pen(16.0, 3))}) == 2
    assert sum(np.asarray(each).nbytes for each in placed(WORLD).given) < 160 * 1024


def test_a_seed_turns_the_start_and_nothing_else():
    one, other = placed(WORLD, 1), placed(WORLD, 2)
    np.testing.assert_array_equal(one.start[:2], [0.0, 0.0])
    assert one.start[2] != other.start[2]
    np.testing.assert_array_equal(one.goals_m, other.goals_m)


def test_from_the_middle_of_a_small_room_nearly_all_is_seen_at_once():
    small = hall(1.0)
    _, metrics = judged(small, truth(0.05, 0.0, 0.0))
    # 10 m long, seen 2.5 m to either side.
    assert metrics["covered_share"] == pytest.approx(0.5, abs=0.05)
    assert metrics["covered_m2"] == pytest.approx(metrics["covered_share"] * 9.5 * 1.5, rel=0.08)


def test_it_is_passed_when_the_share_was_seen():
    way = [truth(0.5 * k, -2.0 + 0.5 * k, 0.0) for k in range(1, 19)]
    verdict, metrics = judged(BARE, *way)
    assert (bool(verdict.done), REASONS[int(verdict.reason)]) == (True, "")
    assert metrics["covered_share"] >= 0.95
    assert 0.5 <= metrics["time_to_50_percent_s"] < metrics["time_to_90_percent_s"] <= 9.0


def test_half_the_floor_is_enough_where_half_is_asked_for():
    assert bool(judged(hall(1.0), truth(0.05, 0.0, 0.0), share=0.4)[0].done)
    assert not bool(judged(hall(1.0), truth(0.05, 0.0, 0.0))[0].done)


def test_a_time_that_never_came_is_no_number():
    assert np.isnan(judged(BARE, truth(0.05, -2.0, 0.0))[1]["time_to_90_percent_s"])


def test_a_viewpoint_is_passed_over_when_its_floor_was_seen():
    goals_m = placed(BARE).goals_m
    beside = truth(0.1, goals_m[0][0], goals_m[0][1] - 0.5)
    assert int(judged(BARE, truth(0.05, -2.0, 0.0))[0].goal_index) == 0
    assert int(judged(BARE, truth(0.05, -2.0, 0.0), beside)[0].goal_index) == 1


@pytest.mark.parametrize(
    ("ending", "reason"),
    [
        (truth(1.0, 0.5, 0.0, impulse_ns=0.5), "collision"),
        (truth(1.0, 9.0, 0.0, inside=False), "out of bounds"),
        (truth(10.1, 0.05, 0.0), "stuck"),
    ],
)
def test_it_is_over_with_the_reason(ending: Truth, reason: str):
    verdict, _ = judged(WORLD, ending)
    assert (bool(verdict.done), REASONS[int(verdict.reason)]) == (True, reason)


@pytest.mark.parametrize(("name", "value"), [("RANGE", "far"), ("SHARE", "all")])
def test_variables_that_are_no_numbers_are_refused(name: str, value: str):
    with pytest.raises(ValueError, match=f"{name}: '{value}': must be a number"):
        scenario({name: value})


@pytest.mark.parametrize(("range_m", "share", "said"), [(0.1, 0.9, "RANGE: 0.1"), (2.0, 1.5, "SHARE: 1.5")])
def test_numbers_that_cannot_be_are_refused(range_m: float, share: float, said: str):
    with pytest.raises(ValueError, match=said):
        placed(WORLD, range_m=range_m, share=share)


def test_a_robot_that_fits_nowhere_is_told_so():
    with pytest.raises(ValueError, match=r"no floor for a robot of 3\.00 m radius"):
        Floor(2.5, 0.95).place(WORLD, mapped(WORLD), 3.0, np.random.default_rng(0))


def test_the_courier_sees_all_the_floor():
    rows = drive(COURIER, COVERAGE, WORLDS, [{}], seeds=2, duration_s=120.0)
    assert [(row.status, row.outcome) for row in rows] == [("Completed", "Passed")] * len(rows)
    for row in rows:
        assert row.spl is row.shortest_path_m is None
        assert row.metrics["covered_share"] >= 0.95
        assert row.metrics["time_to_90_percent_s"] <= row.simulated_s


@pytest.mark.long
def test_it_is_looked_at_with_the_range_that_is_asked_for():
    near, far = drive(COURIER, COVERAGE, {"hand/hall": BARE}, [{"RANGE": "1.5"}, {"RANGE": "4"}], duration_s=1.0)
    assert near.metrics["covered_share"] < 0.7 * far.metrics["covered_share"]
    assert near.goals_total >= far.goals_total


def test_the_tour_begins_where_the_world_says_that_the_robot_starts():
    start = Start(x_m=-1.4, y_m=0.6, yaw_rad=1.0)
    world = WORLD.model_copy(update={"version": "2", "start": start, "rooms": ()})
    begun = placed(world)
    assert begun.start.tolist() == [-1.4, 0.6, 1.0]
    assert not np.array_equal(begun.goals_m[:4], placed(WORLD).goals_m[:4])
    np.testing.assert_array_equal(begun.start, placed(world, 1).start)
