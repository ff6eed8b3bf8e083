"""Chunks say who vouches for them; what nobody vouches for is never counted, and adopted only if it is the same."""

import json
from collections.abc import Sequence

import pytest

from specs.data.episode import EpisodeResult, Failure, failed_result
from specs.errors import StageFailed
from tasks.simulate.batch.batch_record import OpenBatch, load_batch, require_plan
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.simulate.batch.chunk_store import (
    authenticated_bytes,
    commit,
    commit_missing,
    committed_chunk,
    counted_chunk,
    stored_chunk,
)
from tasks.simulate.batch.result_stream import result_parts
from tasks.storage.base.keys import chunk_key, job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tests.factories.episodes import collided, passed
from tests.factories.planned_batches import all_pass, begun

CRASHED, SAID_OTHERWISE = (
    Failure("RobotApplicationCrash", f"node /wander ended with status 7: pid {pid}") for pid in (17, 18)
)
ROWS = [passed(index) for index in range(4)]


@pytest.fixture
def batch(file_store: Store) -> OpenBatch:
    return begun(file_store)


def put(batch: OpenBatch, rows: Sequence[EpisodeResult], number: int = 0) -> None:
    """Writes a chunk as somebody without a key can."""
    batch.store.put(chunk_key(batch.id, number), authenticated_bytes(rows, number, stranger(batch)))


def stranger(batch: OpenBatch) -> BatchAuthenticator:
    return BatchAuthenticator(b"another owner's, or none at all!", batch.id, batch.layout.plan_digest)


def test_the_first_lines_of_a_chunk_are_json_that_says_who_vouches_for_what_follows(batch: OpenBatch):
    assert commit(batch.store, batch.id, 0, ROWS, batch.authenticator).rows() == ROWS
    vouched, said, _ = batch.store.get(chunk_key(batch.id, 0)).body.split(b"\n", 2)
    assert [*json.loads(vouched)] == ["mac"]
    assert json.loads(said)["rows"] == 4
    assert json.loads(said)["columns"]["status"] == {"labels": ["Completed"], "codes": "=i1"}
    assert counted_chunk(batch.store, batch.id, 0, batch.authenticator) == ROWS


def test_a_chunk_of_another_owner_is_shown_and_not_counted(batch: OpenBatch):
    put(batch, ROWS)
    assert committed_chunk(batch.store, batch.id, 0) == ROWS
    with pytest.raises(StageFailed, match=r"000000\.json is not what this owner's process wrote there"):
        counted_chunk(batch.store, batch.id, 0, batch.authenticator)


def test_each_changed_byte_of_a_chunk_is_noticed(batch: OpenBatch):
    commit(batch.store, batch.id, 0, ROWS, batch.authenticator)
    key = chunk_key(batch.id, 0)
    body = batch.store.get(key).body
    for place in (0, 5, 9, 40, 71, 75, 81, len(body) // 2, len(body) - 1):
        changed = bytearray(body)
        changed[place] ^= 1
        batch.store.put(key, bytes(changed))
        found = stored_chunk(batch.store, batch.id, 0, batch.authenticator)
        assert found is not None
        assert not found.authentic
    for cut in (0, 1, 20, 80, len(body) - 1):
        batch.store.put(key, body[:cut])
        found = stored_chunk(batch.store, batch.id, 0, batch.authenticator)
        assert found is not None
        assert not found.authentic


def test_a_chunk_is_not_vouched_for_under_another_number(batch: OpenBatch):
    commit(batch.store, batch.id, 0, ROWS, batch.authenticator)
    batch.store.put(chunk_key(batch.id, 1), batch.store.get(chunk_key(batch.id, 0)).body)
    found = stored_chunk(batch.store, batch.id, 1, batch.authenticator)
    assert found is not None
    assert not found.authentic


def test_what_nobody_vouches_for_is_simulated_anew_and_adopted_if_it_is_the_same(batch: OpenBatch):
    put(batch, ROWS)
    asked: list[int] = []

    def simulate(part: object) -> list[EpisodeResult]:
        asked.append(1)
        return all_pass(part)  # pyright: ignore[reportArgumentType] - it is a part

    run_chunk(batch, 0, simulate, lanes=4, left_s=3600.0)
    assert asked == [1]
    assert counted_chunk(batch.store, batch.id, 0, batch.authenticator) == ROWS
    run_chunk(batch, 0, simulate, lanes=4, left_s=3600.0)
    assert asked == [1]


def test_what_differs_is_refused_with_the_rows_and_stays_for_a_person_to_see(batch: OpenBatch):
    forged = [collided(0), *ROWS[1:]]
    put(batch, forged)
    with pytest.raises(StageFailed) as caught:
        run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
    assert f"{chunk_key(batch.id, 0)} was not written by this owner" in caught.value.reason
    assert "episode 0 says " in caught.value.reason
    assert "outcome 'Failed', computed 'Passed'" in caught.value.reason
    assert "episode 1" not in caught.value.reason
    assert committed_chunk(batch.store, batch.id, 0) == forged


@pytest.mark.parametrize("body", [b"", b"[]", b"null", b"{", b'{"mac":"' + b"0" * 64 + b'"}\n{}'])
def test_a_chunk_that_holds_no_rows_is_refused(batch: OpenBatch, body: bytes):
    batch.store.put(chunk_key(batch.id, 0), body)
    with pytest.raises(StageFailed, match="does not hold the results of its episodes"):
        run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)


def test_another_owner_adopts_nothing_unseen(batch: OpenBatch):
    commit(batch.store, batch.id, 0, ROWS, batch.authenticator)
    with pytest.raises(StageFailed):
        commit(batch.store, batch.id, 0, [collided(0), *ROWS[1:]], stranger(batch))
    assert commit(batch.store, batch.id, 0, ROWS, stranger(batch)).rows() == ROWS


def test_who_of_this_owner_comes_second_gets_what_was_first(batch: OpenBatch):
    commit(batch.store, batch.id, 0, ROWS, batch.authenticator)
    assert commit(batch.store, batch.id, 0, [collided(0), *ROWS[1:]], batch.authenticator).rows() == ROWS
    commit_missing(batch.store, batch.id, 0, [], batch.authenticator)
    assert committed_chunk(batch.store, batch.id, 0) == ROWS


def test_tables_are_never_made_from_what_nobody_vouches_for(batch: OpenBatch):
    put(batch, ROWS)
    with pytest.raises(StageFailed, match="is not what this owner's process wrote"):
        list(result_parts(batch, "Completing"))


def test_a_worker_refuses_a_record_with_another_plan(batch: OpenBatch):
    given = BatchAuthenticator(b"k" * 32, batch.id, "0" * 64)
    with pytest.raises(StageFailed, match="says the plan"):
        load_batch(batch.store, batch.id, given)


def test_a_batch_whose_record_says_another_plan_is_named(batch: OpenBatch):
    assert require_plan(batch.store, batch.id, batch.plan).id == batch.id
    shorter = batch.plan.model_copy(update={"seeds": (0,)})
    with pytest.raises(StageFailed, match=job_key("simulation-job-batch", batch.id)):
        require_plan(batch.store, batch.id, shorter)


def test_how_ros_nodes_kept_up_and_what_they_printed_last_may_differ_another_time(batch: OpenBatch):
    found = [failed_result(index, CRASHED).model_copy(update={"late": 2, "stray": 1}) for index in range(4)]
    ours = [failed_result(row.index, SAID_OTHERWISE).model_copy(update={"late": 0, "stray": 0}) for row in found]
    put(batch, found)
    assert commit(batch.store, batch.id, 0, ours, batch.authenticator).rows() == ours
    assert counted_chunk(batch.store, batch.id, 0, batch.authenticator) == ours


def test_what_ros_nodes_did_may_not_differ(batch: OpenBatch):
    put(batch, [row.model_copy(update={"late": 1, "stray": 0, "path_length_m": 9.0}) for row in ROWS])
    ours = [row.model_copy(update={"late": 0, "stray": 0}) for row in ROWS]
    with pytest.raises(StageFailed, match=r"episode 0 says path_length_m 9.0, computed [\d.]+; episode 1"):
        commit(batch.store, batch.id, 0, ours, batch.authenticator)
