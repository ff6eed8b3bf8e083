"""Staged episodes: ways of equal tasks are measured once, also chunks apart, and variables say where a robot begins."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import HostMap, Placement
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.world_arrays import WorldArrays, arrays_of_worlds
from tasks.simulate.lane import staging
from tasks.simulate.lane.staging import Lane, moved_lane, place, with_shortest_paths
from tests.factories.simulations import cluttered, delivery

HULL = Hull(radius_m=0.2, low_m=0.02, high_m=0.38, mass_kg=2.0)


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many ways were measured, each time that some were."""
    counts: list[int] = []
    whole = staging.shortest_paths_m

    def counted(ways: Sequence[object], *rest: object) -> np.ndarray:
        counts.append(len(ways))
        return whole(ways, *rest)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(staging, "shortest_paths_m", counted)
    return counts


def stage() -> WorldArrays:
    return arrays_of_worlds({"w": cluttered(1)}, HULL, 0.3)["w"]


def placed(at: WorldArrays, *goals: tuple[float, float], arrived_m: float | None = 0.3) -> list[Lane]:
    return [
        Lane(delivery(k, world="w"), at, Placement(np.zeros(3), np.array([goal]), (), arrived_m))
        for k, goal in enumerate(goals)
    ]


GOALS = ((1.0, 0.4), (1.5, -0.4), (1.0, 0.4))


def test_a_task_of_an_earlier_chunk_has_the_same_length_and_is_not_measured_again(measured: list[int]):
    here = stage()
    lengths = [lane.shortest_path_m for lane in with_shortest_paths(placed(here, *GOALS))]
    again = [lane.shortest_path_m for lane in with_shortest_paths(placed(here, (9.0, 9.0), *GOALS))]
    assert (again[1:], measured) == (lengths, [2, 1])
    assert again[0] is None  # there is no way out, which is known of it as well
    assert with_shortest_paths(placed(here, (9.0, 9.0)))[0].shortest_path_m is None
    assert sum(measured) == 3


def test_a_task_is_another_in_another_world_and_for_another_distance_to_arrive_at(measured: list[int]):
    here = stage()
    with_shortest_paths(placed(here, GOALS[0]))
    with_shortest_paths(placed(here, GOALS[0], arrived_m=0.2))
    with_shortest_paths(placed(stage()._replace(ways=type(here.ways)(here.contact_obstacles, 0.1)), GOALS[0]))
    assert with_shortest_paths(placed(here, GOALS[0], arrived_m=None))[0].shortest_path_m is None
    assert sum(measured) == 3


def test_the_tasks_that_were_found_first_are_forgotten_first(measured: list[int], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(staging, "_TASKS_KNOWN", 1)
    here = stage()
    for goal in (GOALS[0], GOALS[1], GOALS[1], GOALS[0]):
        with_shortest_paths(placed(here, goal))
    assert sum(measured) == 3


def lane(x_m: float) -> Lane:
    placement = Placement(np.array([x_m, 2.0, 0.5]), np.array([[1.0, 1.0]]))
    return Lane(delivery(0, world="hand/apartment-0"), cast("Any", None), placement, None)


@pytest.mark.parametrize("x_m", [0.0, 3.7, 900.0, -900.0])
@pytest.mark.parametrize("beside_m", [1e-6, -1e-6])
def test_a_robot_starts_beside_its_place_even_far_from_the_origin(x_m: float, beside_m: float):
    moved = moved_lane(lane(x_m), (beside_m, 0.0)).placement
    apart_m = float(np.float32(moved.start[0])) - float(np.float32(x_m))
    assert np.sign(apart_m) == np.sign(beside_m)
    assert abs(apart_m) < 1e-4
    assert tuple(moved.start[1:]) == (2.0, 0.5)


def test_a_lane_that_is_not_moved_is_the_same():
    assert np.array_equal(moved_lane(lane(3.7), (0.0, 0.0)).placement.start, lane(3.7).placement.start)


# Begins in the left of two rooms.
_SCENARIO: Any = SimpleNamespace(
    arrived_m=0.3, place=lambda *_: Placement(np.array([0.1, 0.1, 0.7]), np.array([[0.3, 0.1]]))
)
# Cells of 10 cm: a room of seven cells in an L, a wall, and a room that nobody gets to. All have room but the wall.
_ROOMS = np.array([[1, 1, 1, 0, 1], [1, 1, 1, 0, 1], [1, 0, 0, 0, 1]], np.float32)


def starts(environment: dict[str, str], rooms: np.ndarray = _ROOMS) -> list[float]:
    """Returns where an episode with such variables begins."""
    floor = HostMap(
        rooms, np.zeros(2, np.float32), np.array(0.1, np.float32), np.array([0.0, 0.0, 0.5, 0.3], np.float32)
    )
    arrays = stage()._replace(floor=floor)
    request = delivery(0, world="w").model_copy(update={"environment": environment})
    placement = place(_SCENARIO, request, cluttered(1), arrays, HULL)
    assert placement.goals_m.tolist() == [[0.3, 0.1]]
    return placement.start.tolist()


def test_without_a_variable_of_the_start_an_episode_begins_where_its_scenario_says():
    assert starts({"MAX_SPEED": "0.5"}) == [0.1, 0.1, 0.7]


def test_shares_of_the_floor_are_as_likely_wherever_a_robot_gets_to_from_there():
    shares = [(row + 0.5) / 42 for row in range(42)]
    found = [
        tuple(starts({"start.x_share": str(x), "start.y_share": str(y)})[:2]) for x in shares for y in shares[3::7]
    ]
    counts = {(round(x / 0.1), round(y / 0.1)): found.count((x, y)) for x, y in found}
    cells = {(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0), (2, 1)}
    assert counts == dict.fromkeys(cells, 36)


@pytest.mark.parametrize(("share", "x_m"), [("0", 0.0), ("1", 0.2)])
def test_both_ends_of_a_share_are_on_the_floor(share: str, x_m: float):
    start = starts({"start.x_share": share, "start.y_share": share})
    assert start == pytest.approx([x_m, x_m / 2.0, 0.7])


def test_one_share_alone_is_of_the_middle_and_a_direction_alone_moves_nobody():
    assert starts({"start.x_share": "0"}) == pytest.approx([0.0, 0.1, 0.7])
    assert starts({"start.yaw_rad": "-3"}) == [0.1, 0.1, -3.0]


def test_which_cells_of_a_world_a_robot_gets_to_is_found_out_once(monkeypatch: pytest.MonkeyPatch):
    label, labelled = staging.ndimage.label, list[object]()
    counted = SimpleNamespace(label=lambda *args, **rest: labelled.append(args) or label(*args, **rest))
    monkeypatch.setattr(staging, "ndimage", counted)
    rooms = _ROOMS.copy()
    first = starts({"start.x_share": "0.9"}, rooms)
    assert starts({"start.x_share": "0.9"}, rooms) == first
    assert len(labelled) == 1
    rooms = np.zeros_like(_ROOMS)
    rooms[0, 0] = 1.0
    assert starts({"start.x_share": "0.9"}, rooms)[:2] == [0.0, 0.0]
    assert len(labelled) == 2


def test_of_many_worlds_only_the_last_ones_are_known(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(staging, "_FLOORS_KNOWN", 3)
    for _ in range(5):
        starts({"start.x_share": "0.9"}, _ROOMS.copy())
    assert len(staging._known_parts) == 3


def goals(environment: dict[str, str], scenario: SimpleNamespace) -> list[list[float]]:
    """Returns the goals of an episode with such variables."""
    request = delivery(0, world="w").model_copy(update={"environment": environment})
    return place(cast("Any", scenario), request, cluttered(1), stage(), HULL).goals_m.tolist()


def test_a_scenario_is_given_the_shares_of_goals_where_variables_say_some():
    given = list[object]()

    def drawn(*_: object, shares: object = "none") -> Placement:
        given.append(shares)
        return Placement(np.zeros(3), np.array([[0.3, 0.1]]))

    scenario = SimpleNamespace(arrived_m=0.3, place=drawn)
    assert goals({"goals.x1_share": "0.25"}, scenario) == goals({"MAX_SPEED": "0.5"}, scenario)
    assert given == [((0.25, 0.5), None), "none"]


def test_shares_of_goals_that_a_scenario_does_not_know_are_its_failure():
    assert goals({"MAX_SPEED": "0.5"}, _SCENARIO) == [[0.3, 0.1]]
    with pytest.raises(BundleCrash, match=r"goals: scenario\.place has no argument shares"):
        goals({"goals.y2_share": "0.5"}, _SCENARIO)


def test_a_world_without_room_is_the_scenarios_failure():
    with pytest.raises(BundleCrash, match="start: the world has no room for the robot to begin in"):
        starts({"start.x_share": "0.5"}, np.zeros((2, 2), np.float32))
