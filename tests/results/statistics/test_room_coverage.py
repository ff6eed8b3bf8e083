"""Rooms that robots were in are counted over a batch, and a batch that saw a part of its worlds says so."""

from specs.data.episode import EpisodeResult
from specs.data.episode_columns import pair_columns
from tasks.results.statistics.room_coverage import (
    RoomCoverage,
    RoomTally,
    coverage_line,
    coverage_warnings,
    table_coverage,
)
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import canceled, collided, passed, request

ROOMS = ("Hall", "Kitchen", "Bedroom")


def inside(
    *entered: str, unreachable: tuple[str, ...] = (), goals_reachable: int = 3, **changes: object
) -> EpisodeResult:
    known = {"rooms_entered": entered, "rooms_unreachable": unreachable, "rooms_total": len(ROOMS)}
    return passed(0).model_copy(update={**known, "goals_reachable": goals_reachable, **changes})


def count(tally: RoomTally, result: EpisodeResult, world: str) -> None:
    tally.add_columns(*pair_columns([request(0, world=world)], [result.model_copy(update={"index": 0})]))


def coverage(*results: EpisodeResult, world: str = "g/w") -> RoomCoverage:
    tally = RoomTally()
    for each in results:
        count(tally, each, world)
    found = tally.coverage()
    assert found is not None
    return found


def test_a_room_counts_once_however_many_episodes_were_in_it():
    found = coverage(inside("Hall"), inside("Hall", "Kitchen"))
    assert (found.entered, found.rooms, found.worlds) == (2, 3, 1)
    assert coverage_line(found) == "rooms entered: 2 of 3; goals within reach: 6 of 6 (100 %)"


def test_rooms_of_the_same_name_in_two_worlds_are_two_rooms():
    tally = RoomTally()
    for world in ("g/a", "g/b"):
        count(tally, inside("Hall", "Kitchen"), world)
    found = tally.coverage()
    assert found is not None
    assert coverage_line(found).startswith("rooms entered: 4 of 6 in 2 worlds")


def test_rooms_out_of_reach_are_warned_of_by_name():
    found = coverage(inside("Hall", "Kitchen", unreachable=("Bedroom",)))
    (warning,) = coverage_warnings(found)
    assert warning.startswith("The robot cannot get to 1 of 3 rooms")
    assert "Bedroom in g/w" in warning


def test_a_room_that_some_robot_was_in_is_not_out_of_reach():
    found = coverage(inside("Hall", unreachable=("Bedroom",)), inside("Bedroom", "Kitchen"))
    assert found.unreachable == 0


def test_a_batch_that_passed_in_one_room_alone_is_warned_of():
    assert "stayed in one room" in coverage_warnings(coverage(inside("Hall"), inside("Hall")))[0]
    assert coverage_warnings(coverage(inside("Hall"), inside("Hall", "Kitchen"))) == []


def test_a_world_of_one_room_is_no_reason_to_warn():
    assert coverage_warnings(coverage(inside("Hall", rooms_total=1))) == []


def test_failures_in_the_first_room_are_no_reason_to_warn():
    stuck = inside("Hall", outcome="Failed", outcome_reason="stuck")
    assert coverage_warnings(coverage(stuck)) == []


def test_goals_out_of_reach_are_warned_of_and_never_rounded_away():
    few = inside("Hall", "Kitchen", goals_total=10_000, goals_reachable=9_999)
    found = coverage(few)
    assert coverage_line(found).endswith("9,999 of 10,000 (99.9 %)")
    assert "1 of 10,000 goals" in coverage_warnings(found)[0]


def test_episodes_that_did_not_start_say_nothing():
    tally = RoomTally()
    count(tally, canceled(0), "g/w")
    assert tally.coverage() is None


def test_tables_and_episodes_are_counted_alike():
    results = [inside("Hall", unreachable=("Bedroom",)), collided(1)]
    rows = results_table("b", [request(0, world="g/w"), request(1, world="g/w")], results)
    assert table_coverage(rows) == coverage(*results)
