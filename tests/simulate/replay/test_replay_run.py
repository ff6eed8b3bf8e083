"""A replay in another process blames its episode only where no other one can be to blame; many say what comes next."""

import pytest

from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.batch.batch_record import load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkPart
from tasks.simulate.replay.replay_result import ReplayResult
from tasks.simulate.replay.replay_run import drive_apart, resimulate
from tasks.simulate.sandbox.protocol import Replayed
from tasks.storage.base.store import Store
from tests.factories import planned_batches
from tests.factories.batches import pushing_plan
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


def test_of_many_episodes_the_next_two_chunks_are_said_with_each_and_of_parts_of_one_none_is_whole(store: Store):
    plan = pushing_plan(store)
    batch = load_batch(store, open_batch(store, plan, planned_batches.request(plan), "tok").id)
    first, told = batch.layout.request(0), list[tuple[int, list[int], bool]]()

    def simulate(part: ChunkPart) -> EpisodeColumns:
        coming = [each.able.number for each in part.coming]
        told.append((len(part.chunk.requests), coming, part.whole))
        if len(told) == 1:
            raise MemoryError
        return EpisodeColumns.of([passed(each.index) for each in part.chunk.requests])

    asked = [first.model_copy(update={"index": 100 + number, "seed": number}) for number in range(60)]
    rows = resimulate(batch, asked, simulate, 16)
    assert [row.index for row in rows] == [each.index for each in asked]
    assert told == [
        (16, [1, 2], True),
        (8, [1, 2], False),
        (8, [1, 2], False),
        (16, [2, 3], True),
        (16, [3], True),
        (12, [], True),
    ]
