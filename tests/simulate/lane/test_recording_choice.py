"""Which episodes are recorded follows from how they end, and from who asked for them."""

import pytest

from specs.data.episode import unfinished_result
from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.lane.recording import RecordingChoice
from tests.factories.episodes import collided, crashed, passed

ROWS = EpisodeColumns.of(
    [
        passed(0),
        collided(1),
        crashed(2),
        passed(3),
        unfinished_result(4, "Canceled", failure_code="", failure_reason=""),
    ]
)


@pytest.mark.parametrize(
    ("choice", "chosen"),
    [
        (RecordingChoice(), []),
        (RecordingChoice(failed=True), [1, 2]),
        (RecordingChoice(always=(3, 4)), [3]),
        (RecordingChoice(always=(0, 4), failed=True), [0, 1, 2]),
    ],
)
def test_episodes_that_were_asked_for_or_failed_are_recorded_if_they_came_to_an_end(
    choice: RecordingChoice, chosen: list[int]
):
    assert ROWS.index[choice.chosen(ROWS)].tolist() == chosen
