"""Rows that an older version committed still count."""

from specs.data.episode import EpisodeResult
from tests.factories.episodes import passed

ADDED = {"goal_times_s", "impulse_ns", "max_impulse_ns", "odometry_error_m", "late", "stray", "metrics"}


def test_a_row_without_the_later_measures_is_read():
    row = passed(3).model_dump(mode="json")
    older = {name: value for name, value in row.items() if name not in ADDED}
    assert EpisodeResult.model_validate(older) == passed(3)


def test_a_row_comes_back_as_it_was_written():
    row = passed(3).model_copy(update={"metrics": {"seen_share": 0.75}, "goal_times_s": (3.5, 9.0), "spl": None})
    assert EpisodeResult.model_validate_json(row.model_dump_json()) == row
