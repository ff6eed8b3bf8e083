"""Which failures are shown: few, of every kind, apart from one another, and the same ones every time."""

from pathlib import Path

from tasks.results.report.failure_maps import DRAWN, LISTED, choose_failures
from tasks.results.report.report_columns import Failures, read_failures, read_ways
from tests.factories.episodes import collided, request
from tests.factories.reports import written

WORLD = "wgj-1/world-1-1"


def failures(folder: Path, reasons: list[str], ends_m: list[tuple[float, float]] | None = None) -> Failures:
    places = ends_m or [(float(index), 0.0) for index in range(len(reasons))]
    results = [
        collided(index).model_copy(update={"outcome_reason": reason, "final_x_m": x, "final_y_m": y})
        for index, (reason, (x, y)) in enumerate(zip(reasons, places, strict=True))
    ]
    return read_failures(written(folder, [request(index) for index in range(len(reasons))], results)[1])


def test_a_rare_reason_is_shown_among_many_of_another(tmp_path: Path):
    pick = choose_failures(failures(tmp_path, ["timeout"] * 200 + ["collision"]), [WORLD])[WORLD]
    assert 200 in pick.listed


def test_there_are_never_more_than_are_looked_at(tmp_path: Path):
    pick = choose_failures(failures(tmp_path, ["timeout", "stuck"] * 100), [WORLD])[WORLD]
    assert (len(pick.listed), len(pick.drawn), pick.failures) == (LISTED, DRAWN, 200)
    assert set(pick.listed) <= set(pick.drawn)


def test_failures_at_other_places_are_listed_before_more_of_the_same_place(tmp_path: Path):
    ends_m = [(0.0, 0.0)] * 10 + [(5.0, 5.0)]
    pick = choose_failures(failures(tmp_path, ["stuck"] * 11, ends_m), [WORLD])[WORLD]
    assert 10 in pick.listed
    assert len(pick.listed) == LISTED


def test_a_world_without_failures_has_nothing_to_show(tmp_path: Path):
    pick = choose_failures(failures(tmp_path, ["stuck"]), ["wgj-1/other"])["wgj-1/other"]
    assert (pick.listed, pick.drawn, pick.failures) == ((), (), 0)


def test_ways_are_read_by_row_also_across_row_groups(tmp_path: Path):
    count = 9_000  # more than one row group
    results = [
        collided(index).model_copy(update={"trajectory": ((0.0, float(index), 1.0, 0.0),)}) for index in range(count)
    ]
    file = written(tmp_path, [request(index) for index in range(count)], results)[1]
    ways = read_ways(file, [3, 8_191, 8_192, 8_999])
    assert {row: way.tolist() for row, way in ways.items()} == {row: [[row, 1.0]] for row in (3, 8_191, 8_192, 8_999)}
