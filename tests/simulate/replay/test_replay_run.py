"""A replay in another process blames its episode only where no other one can be to blame."""

import pytest

from tasks.simulate.replay.replay_result import ReplayResult
from tasks.simulate.replay.replay_run import drive_apart
from tasks.simulate.sandbox.protocol import Replayed
from tests.factories.episodes import passed, request
from tests.factories.worlds import apartment
from tests.simulate.ending_simulators import ended, use_simulators


def driven() -> ReplayResult:
    asked = request(0)
    return drive_apart(asked, {asked.world: apartment()}, {}, lanes=8, engine="auto", rate_hz=1.0)


def test_a_replay_whose_process_ended_beside_chunks_ahead_is_asked_once_more(monkeypatch: pytest.MonkeyPatch):
    asked = use_simulators(monkeypatch, [ended(beside_others=True), Replayed(row=passed(0), started=False)])
    assert driven().row == passed(0)
    assert asked[0] == asked[1]


def test_an_episode_that_ends_a_process_that_knows_of_no_other_has_its_row(monkeypatch: pytest.MonkeyPatch):
    asked = use_simulators(monkeypatch, [ended(beside_others=False)])
    row = driven().row
    assert (row.status, row.failure_reason, len(asked)) == ("Failed", "the process ended with exit code 3", 1)
