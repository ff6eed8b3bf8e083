"""Rows of lanes that ended together are those of each by itself, however long each drove."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from specs.data.column_bytes import encode_columns
from specs.data.episode import CONTROL_S
from specs.data.episode_columns import EpisodeColumns
from tasks.results.gate.impossible_rows import impossible_rows
from tasks.results.tables.episode_tables import results_table
from tasks.simulate.application.contract import REASONS, Placement
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.rooms import RoomMap, Visit, visits
from tasks.simulate.geometry.world_arrays import arrays_of_worlds
from tasks.simulate.lane import result_rows
from tasks.simulate.lane.control_step import NO_CRASH, ROBOT_CRASH, EpisodeTotals, LaneState
from tasks.simulate.lane.result_rows import Ended, finished_rows
from tasks.simulate.lane.staging import Lane, with_shortest_paths
from tests.factories.simulations import cluttered, delivery, hall

LANES, SLICE = 8, 25
# Of the lanes, in which slice each began, and how many control steps it did; one ended at once.
BEGAN = (0, 0, 1, 2, 3, 3, 1, 3)
STEPS = (100, 83, 75, 41, 7, 0, 60, 25)
HULL = Hull(radius_m=0.2, low_m=0.02, high_m=0.38, mass_kg=2.0)
STAGES = arrays_of_worlds({"w/0": cluttered(1), "w/1": cluttered(2)}, HULL, 0.3)


def lane(number: int) -> Lane:
    placement = Placement(np.array([0.1 * number, 0.0, 0.5]), np.array([[1.0, 0.4], [1.5, -0.4]]))
    world = f"w/{number % 2}"
    shortest_m = None if number == 4 else 0.0 if number == 6 else 1.25 * number
    return Lane(delivery(20 + number, world=world), STAGES[world], placement, shortest_m)


@pytest.fixture
def state() -> LaneState:
    rng = np.random.default_rng(3)
    reals = rng.uniform(0.0, 9.0, (8, LANES)).astype(np.float32)
    pose = rng.uniform(-1.0, 1.0, (LANES, 3)).astype(np.float32)
    reached = np.where(np.arange(LANES) % 2 == 0, STEPS, 0)
    numbers: dict[str, Any] = {
        "step": np.array(STEPS),
        "goal_index": np.arange(LANES),
        "goal_steps": np.stack([np.minimum(STEPS, 3), reached], axis=1),
        "reason": np.array([0, 0, 0, 1, 1, 1, 0, REASONS.index("crash")]),
        "crash": np.array([NO_CRASH] * (LANES - 1) + [ROBOT_CRASH]),
        "metrics": {"bumps": reals[5], "turns": np.where(np.arange(LANES) % 3 == 0, np.nan, reals[6])},
        "sensed": {"odometry": pose + np.float32(0.1)},
        "body": SimpleNamespace(qpos=pose),
    }
    totals: dict[str, Any] = {"collisions": np.arange(LANES), "touching": np.arange(LANES) < 0}
    names = ("path_length_m", "impulse_ns", "max_impulse_ns", "min_clearance_m", "energy_j")
    totals |= dict(zip(names, reals[:5], strict=True))
    totals["min_clearance_m"][3] = np.inf
    return LaneState(controller=(), scenario=(), done=numbers["crash"] == 0, totals=EpisodeTotals(**totals), **numbers)


@pytest.fixture
def poses() -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    return [rng.uniform(-3.0, 3.0, (LANES, SLICE, 3)).astype(np.float32) for _ in range(4)]


def test_rows_of_lanes_together_are_those_of_each_by_itself(state: LaneState, poses: list[np.ndarray]):
    ended = [Ended(lane(place), place, 4 - BEGAN[place]) for place in (3, 0, 7, 5, 1, 2, 6, 4)]
    together = finished_rows(ended, state, poses, hull=HULL, engine="planar", device="cpu")
    alone = [
        finished_rows([each], state, poses[4 - each.slices :], hull=HULL, engine="planar", device="cpu")
        for each in ended
    ]
    assert together.rows() == [row for each in alone for row in each]
    assert encode_columns(together) == encode_columns(EpisodeColumns.of(together.rows()))


@pytest.mark.parametrize(("at_once", "looks"), [(1, 8), (3 * 100, 6), (1 << 20, 2)])
def test_no_more_poses_are_looked_at_together_than_memory_has_room_for(
    state: LaneState, poses: list[np.ndarray], monkeypatch: pytest.MonkeyPatch, at_once: int, looks: int
):
    ended = [Ended(lane(place), place, 4 - BEGAN[place]) for place in range(LANES)]
    together = finished_rows(ended, state, poses, hull=HULL, engine="planar", device="cpu")
    sizes: list[int] = []

    def look(rooms: RoomMap, placements: Sequence[Placement], *more: Any) -> list[Visit]:  # noqa: ANN401 - given on
        sizes.append(len(placements))
        return visits(rooms, placements, *more)

    monkeypatch.setattr(result_rows, "visits", look)
    monkeypatch.setattr(result_rows, "_POSES_AT_ONCE", at_once)
    parts = finished_rows(ended, state, poses, hull=HULL, engine="planar", device="cpu")
    assert encode_columns(parts) == encode_columns(together)
    assert (len(sizes), sum(sizes)) == (looks, LANES)


def test_a_row_says_what_its_lane_did(state: LaneState, poses: list[np.ndarray]):
    rows = finished_rows(
        [Ended(lane(3), 3, 2), Ended(lane(5), 5, 1), Ended(lane(6), 6, 3)], state, poses, hull=HULL
    ).rows()
    driven, at_once, passed = rows
    assert [t_s for t_s, *_ in driven.trajectory] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.05]
    assert driven.trajectory[0][1:] == tuple(np.array([0.3, 0.0, 0.5], np.float32).tolist())
    assert driven.trajectory[-1][1:] == tuple(poses[3][3, 41 - SLICE - 1].tolist())
    assert (driven.min_clearance_m, driven.spl, driven.goal_times_s) == (0.0, 0.0, (0.15,))
    assert [pose[0] for pose in at_once.trajectory] == [0.0]
    assert (passed.trajectory, passed.spl, passed.simulated_s) == ((), 1.0, round(60 * CONTROL_S, 6))
    assert set(passed.metrics) == {"bumps"}
    unknown = finished_rows([Ended(lane(4), 4, 1), Ended(lane(2), 2, 3)], state, poses, hull=HULL).rows()
    assert [row.spl is None for row in unknown] == [True, False]


def test_a_crash_is_told_with_whose_it_was(state: LaneState, poses: list[np.ndarray]):
    (row,) = finished_rows([Ended(lane(7), 7, 1)], state, poses, hull=HULL)
    assert (row.status, row.failure_code, row.outcome) == ("Failed", "RobotApplicationCrash", "Failed")


@pytest.mark.parametrize(("gap_m", "shortest_m"), [(0.3, 5.0), (0.0, 15.0)])
def test_a_narrow_robot_may_go_where_the_disc_around_it_cannot(
    state: LaneState, poses: list[np.ndarray], gap_m: float, shortest_m: float
):
    (arrays,) = arrays_of_worlds({"w/0": hall(8.0, gap_m=gap_m)}, HULL, 0.3).values()
    asked = delivery(0, world="w/0")
    lanes = with_shortest_paths([Lane(asked, arrays, Placement(np.zeros(3), np.array([[5.0, 0.0]])))])
    state.totals.path_length_m[0] = 5.0
    (row,) = finished_rows([Ended(lanes[0], 0, 4)], state, poses, hull=HULL).rows()
    assert row.shortest_path_m == pytest.approx(shortest_m, rel=0.02)
    assert row.spl == 1.0, "no less than the disc's"
    sound = row.model_copy(update={"collisions": 0, "impulse_ns": 0.0, "max_impulse_ns": 0.0, "goals_reached": 1})
    cannot_be = impossible_rows(results_table("simb-1", [asked], [sound]))
    assert ("less than half of the shortest way" in cannot_be) == (not gap_m), cannot_be
