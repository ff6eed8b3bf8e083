"""What is counted: every episode once in every table, in the group that it belongs to."""

from pathlib import Path

import pytest

from tasks.results.report.batch_facts import Judgement
from tasks.results.report.rate_tables import RateTable
from tasks.results.report.report_columns import BETWEEN
from tasks.results.report.report_view import ReportView
from tests.factories.episodes import ROBOT, collided, passed, request
from tests.factories.reports import WORLDS, episodes, facts, view


def tables(found: ReportView) -> dict[str, RateTable]:
    return {table.caption: table for column in found.columns for table in column}


def counts(table: RateTable) -> dict[str, str]:
    return {row.label: row.counts for row in table.rows}


def test_every_table_counts_every_episode_once(tmp_path: Path):
    found = view(tmp_path)
    assert found.whole.counts == "6 of 10, 2 canceled"
    for table in tables(found).values():
        numbers = [row.counts.partition(",")[0].split(" of ") for row in table.rows]
        assert sum(int(successes) for successes, _ in numbers) == 6
        assert sum(int(episodes) for _, episodes in numbers) == 10


def test_worlds_and_values_have_their_own_numbers(tmp_path: Path):
    found = tables(view(tmp_path))
    assert counts(found["By world"]) == {"world-1-1": "6 of 6", "world-2-1": "0 of 4, 2 canceled"}
    assert counts(found["By MAX_SPEED"]) == {"0.3": "6 of 6", "0.6": "0 of 4, 2 canceled"}
    assert "By GOALS" not in found


def test_values_stand_in_the_order_of_the_document(tmp_path: Path):
    found = tables(view(tmp_path, variables={"MAX_SPEED": ("0.6", "0.3")}))
    assert [row.label for row in found["By MAX_SPEED"].rows] == ["0.6", "0.3"]


def test_a_variable_that_some_episodes_do_not_set_has_a_group_of_those(tmp_path: Path):
    requests = [request(0, environment={"MODE": "fast"}), request(1)]
    found = view(tmp_path, requests, [passed(0), passed(1)], variables={"MODE": ("fast", None)})
    assert counts(tables(found)["By MODE"]) == {"fast": "1 of 1", "(not set)": "1 of 1"}


def test_two_builds_of_a_version_have_their_own_numbers(tmp_path: Path):
    builds = [request(0), request(1).model_copy(update={"robot": ROBOT.model_copy(update={"digest": "e" * 64})})]
    found = counts(tables(view(tmp_path, builds, [passed(0), collided(1)]))["By application"])
    shown = {f"courier 1 go_to_goal {digit * 12} in delivery $LATEST rooms" for digit in "ae"}
    assert (set(found), set(found.values())) == (shown, {"1 of 1", "0 of 1"})


@pytest.mark.parametrize(
    ("end_m", "room"),
    [((0.0, 0.0), "Living"), ((4.0, -1.0), "Kitchen"), ((2.55, 0.5), BETWEEN), ((99.0, 0.0), BETWEEN)],
)
def test_an_episode_belongs_to_the_room_that_it_ended_in(end_m: tuple[float, float], room: str, tmp_path: Path):
    ends = [passed(0).model_copy(update={"final_x_m": end_m[0], "final_y_m": end_m[1]}), passed(1)]
    elsewhere = ends[1].model_copy(update={"final_x_m": 0.0 if room != "Living" else 4.0, "final_y_m": 0.0})
    found = view(tmp_path, [request(0), request(1)], [ends[0], elsewhere])
    assert counts(tables(found)["By room of the end"])[room] == "1 of 1"


def test_a_table_of_rooms_with_a_single_one_says_nothing_and_is_left_out(tmp_path: Path):
    assert "By room of the start" not in tables(view(tmp_path))


def test_reasons_come_most_frequent_first_with_what_one_of_them_said(tmp_path: Path):
    requests, results = episodes(10)
    found = view(tmp_path, requests, results).reasons
    assert [(row.reason, row.count) for row in found] == [("RobotApplicationCrash", 2), ("collision", 2)]
    assert found[0].sample == "the controller returned a control that is no number"


def test_a_world_that_cannot_be_read_is_counted_but_not_drawn(tmp_path: Path):
    found = view(tmp_path, worlds={})
    assert found.maps == ()
    assert set(counts(tables(found)["By world"])) == {world.partition("/")[2] for world in WORLDS}


def test_of_worlds_like_these_only_the_version_counts_that_was_judged(tmp_path: Path):
    asked = [request(index, world=WORLDS[index % 2]) for index in range(8)]
    builds = [each.model_copy(update={"robot": ROBOT.model_copy(update={"digest": "e" * 64})}) for each in asked[4:]]
    results = [*map(passed, range(4)), *map(collided, range(4, 8))]
    judged = Judgement(verdict="PASS", sentence="PASS", at_least=0.5, confidence=0.95, digests=(ROBOT.digest,))
    found = view(tmp_path, [*asked[:4], *builds], results, judgement=judged).like_these
    assert (found.spread.worlds, found.spread.episodes, found.interval and found.interval.upper) == (2, 4, 1.0)


def test_stages_come_slowest_first(tmp_path: Path):
    stages = facts().stages
    quick = stages[0].model_copy(update={"name": "worldExport", "seconds": 1.0})
    found = view(tmp_path, stages=(quick, *stages)).stages
    assert [(row.name, row.width) for row in found] == [("simulationBatch", "100.00%"), ("worldExport", "6.58%")]


def test_maps_come_with_most_failures_first_and_say_what_they_leave_out(tmp_path: Path):
    found = view(tmp_path).maps
    assert [(each.world, each.failures, each.not_drawn, each.not_listed) for each in found] == [
        ("world-2-1", 4, 0, 0),
        ("world-1-1", 0, 0, 0),
    ]
    assert [way.number for way in found[0].ways] == ["1", "2", "3", "4"]
    assert found[1].dots.count("M") == 6
