"""What a report shows: groups, reasons, rooms, the audit, stages."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from specs.data.parity_audit import (
    ApartQuantiles,
    AuditControl,
    AuditReport,
    Flip,
    FlipShare,
    TotalShare,
)
from specs.data.people import People
from specs.data.world import FloorZone, World
from tasks.results.report.batch_facts import Judgement
from tasks.results.report.rate_tables import RateTable
from tasks.results.report.report_columns import BETWEEN, read_episodes, read_people, start_rooms
from tasks.results.report.report_page import report_page
from tasks.results.report.report_view import ReportView, audit_view
from tests.factories.episodes import ROBOT, collided, passed, request
from tests.factories.own_worlds import walled_hall
from tests.factories.reports import WORLDS, as_read, episodes, facts, view, written


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


def test_a_zone_is_a_room_by_its_name(tmp_path: Path):
    outlines = {
        "left": ((10.0, 5.0), (12.0, 5.0), (12.0, 9.0), (10.0, 9.0)),
        "right": ((12.0, 5.0), (16.0, 5.0), (16.0, 9.0)),
    }
    zones = tuple(FloorZone(name=name, outline_m=corners, found=False) for name, corners in outlines.items())
    zoned = walled_hall().model_copy(update={"zones": zones})
    worlds: dict[str, World] = {name: zoned for name in WORLDS}  # noqa: C420 - whose keys are any text
    ends = [passed(k).model_copy(update={"final_x_m": x_m, "final_y_m": 6.0}) for k, x_m in enumerate((11.0, 15.0))]
    found = tables(view(tmp_path, [request(0), request(1)], ends, worlds=worlds))
    assert counts(found["By room of the end"]) == {"left": "1 of 1", "right": "1 of 1"}
    assert found["By room of the end"].head == "Room"
    read = read_episodes(written(tmp_path, [request(0)], ends[:1])[0], ())
    assert start_rooms(read, as_read(worlds)).names == ("left",)


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


AUDIT = AuditReport(
    verdict="SUSPECT",
    sentence="outcomes flip",
    engine="planar",
    compared=16,
    final=ApartQuantiles(median_m=0.000012, p90_m=0.25, max_m=1.5),
    flips=tuple(Flip(index=index, row="Passed", reference="collision") for index in range(10)),
    unreproduced=(3,),
    unlocked=(3, 4),
)


def test_every_figure_is_told():
    lines = {line.label: line.text for line in audit_view(AUDIT).lines}
    assert lines["Compared"] == "16 episodes of planar with mujoco"
    assert lines["Apart at the end"] == "median 1.2e-05 m, p90 0.25 m, max 1.5 m"
    assert lines["Could not be made again"] == "job 3"
    assert lines["Lock-step did not hold"] == "job 3; job 4"


def test_directions_have_their_intervals_and_the_control_says_what_is_chaos():
    report = AuditReport(
        verdict="SOUND",
        sentence="",
        compared=32,
        false_passes=FlipShare(lanes=24, flips=2, chaotic=1, rate=0.08, lower=0.01, upper=0.27, chance=0.3),
        false_alarms=FlipShare(lanes=8, rate=0.0, lower=0.0, upper=0.37, chance=1.0),
        total=TotalShare(rate=0.075, lower=0.0, upper=0.2),
        control=AuditControl(lanes=32, drives=2, flips=3, rate=0.04, lower=0.0, upper=0.1),
        flips=(
            Flip(index=1, row="Passed", reference="timeout", chaotic=True),
            Flip(index=9, row="Passed", reference="collision", chaotic=False),
        ),
        others=(Flip(index=4, row="stuck", reference="timeout"),),
    )
    lines = {line.label: line.text for line in audit_view(report).lines}
    assert lines["False passes"] == "2 of 24 passes fail on C MuJoCo (8.0 %, 95 % interval 1.0 to 27.0 %)"
    assert lines["False alarms"] == "0 of 8 failures pass on C MuJoCo (0.0 %, 95 % interval 0.0 to 37.0 %)"
    assert "Missed contacts" not in lines
    assert lines["In the whole batch"].endswith("in 7.5 %, 95 % interval 0.0 to 20.0 %")
    assert lines["C MuJoCo against itself"] == (
        "two of its drives, a micrometre apart, differ in success in 4.0 %, 95 % interval 0.0 to 10.0 %; "
        "1 of 2 flips are of lanes that it flips itself; "
        "an engine as good as it has so many false passes in 30.0 % of such audits"
    )
    assert lines["Came to another end"] == (
        "job 1: Passed, not timeout (C MuJoCo itself flips it); job 9: Passed, not collision"
    )
    assert lines["Ended otherwise, with the same success"] == "job 4: stuck, not timeout"


def test_the_first_episodes_that_flipped_are_named_and_the_others_counted():
    text = next(line.text for line in audit_view(AUDIT).lines if line.label == "Came to another end")
    assert text.startswith("job 0: Passed, not collision; job 1: ")
    assert text.endswith("job 7: Passed, not collision, and 2 more")


def test_only_what_speaks_against_the_numbers_is_an_alarm():
    verdicts = ("SOUND", "NOT COMPARED", "SUSPECT", "NOT RUN")
    found = [AUDIT.model_copy(update={"verdict": verdict}) for verdict in verdicts]
    assert [audit_view(each).alarming for each in found] == [False, False, True, True]


def test_an_audit_that_could_not_be_made_has_no_figures():
    assert audit_view(AuditReport(verdict="NOT RUN", sentence="no memory")).lines == ()


@pytest.mark.parametrize(("walk", "said"), [((2,), "2 in each world"), ((4, 2), "2 or 4 in each world")])
def test_the_page_says_how_many_people_walked(tmp_path: Path, walk: tuple[int, ...], said: str):
    asked, answered = episodes()
    among = [
        each.model_copy(update={"people": People(count=walk[number % len(walk)])}) for number, each in enumerate(asked)
    ]
    assert f"<dt>People</dt><dd>{said}</dd>" in report_page(view(tmp_path, among, answered)).decode()


def test_numbers_of_people_that_a_matrix_varies_have_their_own_rates(tmp_path: Path):
    asked, answered = episodes()
    counts_of = ("8", "2")
    varied = [
        each.model_copy(update={"people": People(count=4), "environment": {"people.count": counts_of[number % 2]}})
        for number, each in enumerate(asked)
    ]
    found = view(tmp_path, varied, answered, variables={"people.count": counts_of})
    table = tables(found)["By people.count"]
    assert [(row.label, row.counts) for row in table.rows] == [("8", "6 of 6"), ("2", "0 of 4, 2 canceled")]
    assert table.rows[0].interval == "42.9 to 100.0\u00a0%"
    assert "<dt>People</dt><dd>2 or 8 in each world</dd>" in report_page(found).decode()


def test_the_page_says_nothing_of_people_where_nobody_walked(tmp_path: Path):
    assert "<dt>People</dt>" not in report_page(view(tmp_path)).decode()


def test_tables_of_before_there_were_people_have_none(tmp_path: Path):
    path, _ = written(tmp_path, *episodes())
    pq.write_table(pq.read_table(path).drop_columns(["people"]), path)
    assert read_people(path) == ()
