import subprocess
import sys
import time
from pathlib import Path
from threading import Event, Thread

import pytest

from specs.errors import ObjectConflict, StoreError, StoreUnreachable
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs import claim as claims
from tasks.storage.jobs.claim import ClaimRecord, ProcessIdentity, hold_claim, hold_claim_unless_alive, this_process
from tests.servers.eventually import eventually

_KEY = claim_key("world-generation-job", "wgj-0")
_FOREVER_S = 100_000.0
_HOLD = """
import sys
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.store_url import open_store
with hold_claim(open_store(sys.argv[1]), sys.argv[2], ttl_s=float(sys.argv[3])):
    print("held", flush=True)
    input()
"""
_ELSEWHERE = ProcessIdentity(host="elsewhere", pid=1, started="1")


def _record(store: Store) -> ClaimRecord:
    return ClaimRecord.model_validate_json(store.get(_KEY).body)


def _held_elsewhere(ttl_s: float) -> bytes:
    record = ClaimRecord(owner="other", process=_ELSEWHERE, epoch=4, beat=0, ttl_s=ttl_s, released=False)
    return record.model_dump_json().encode()


def test_each_taking_raises_the_epoch(store: Store) -> None:
    epochs: list[int] = []
    for _ in range(3):
        with hold_claim(store, _KEY) as claim:
            epochs.append(claim.epoch)
    assert epochs == [1, 2, 3]


def test_a_claim_is_released_when_the_work_fails(file_store: Store) -> None:
    with pytest.raises(ValueError, match="work"), hold_claim(file_store, _KEY, ttl_s=_FOREVER_S):
        raise ValueError("work")
    with hold_claim(file_store, _KEY) as claim:
        assert claim.epoch == 2


def test_a_killed_holder_is_replaced_without_waiting_for_its_time_to_pass(store: Store) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", _HOLD, store.url, _KEY, str(_FOREVER_S)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"held\n"
        child.kill()
        with hold_claim(store, _KEY) as claim:
            assert claim.epoch == 2


def _enter(store: Store, order: list[str], name: str) -> Thread:
    def work() -> None:
        with hold_claim(store, _KEY):
            order.append(name)

    thread = Thread(target=work)
    thread.start()
    return thread


def test_others_wait_while_a_live_process_holds_the_claim(store: Store) -> None:
    order: list[str] = []
    with hold_claim(store, _KEY):
        waiting = _enter(store, order, "second")
        time.sleep(0.5)
        order.append("first")
    waiting.join()
    assert order == ["first", "second"]


def test_a_holder_elsewhere_keeps_its_claim_as_long_as_it_beats(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "this_process", lambda: _ELSEWHERE)
    order: list[str] = []
    with hold_claim(file_store, _KEY, ttl_s=0.6) as claim:
        waiting = _enter(file_store, order, "second")
        time.sleep(2)
        assert not claim.lost
        order.append("first")
    waiting.join()
    assert order == ["first", "second"]


def test_a_silent_holder_elsewhere_is_replaced_after_its_time(store: Store) -> None:
    store.create(_KEY, _held_elsewhere(ttl_s=0.3))
    with hold_claim(store, _KEY) as claim:
        assert claim.epoch == 5


def test_a_holder_elsewhere_that_beats_is_not_waited_for(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "this_process", lambda: _ELSEWHERE)
    with hold_claim(file_store, _KEY, ttl_s=0.6) as held, hold_claim_unless_alive(file_store, _KEY) as claim:
        assert claim is None
        assert not held.lost
        assert _record(file_store).epoch == 1


def test_the_claim_of_a_silent_holder_elsewhere_is_taken_after_its_time(store: Store) -> None:
    store.create(_KEY, _held_elsewhere(ttl_s=0.3))
    with hold_claim_unless_alive(store, _KEY) as claim:
        assert claim is not None
        assert claim.epoch == 5
    assert _record(store).released


@pytest.mark.parametrize("before", ["nobody", "released"])
def test_a_claim_that_nobody_holds_is_taken_without_watching(before: str, file_store: Store) -> None:
    if before == "released":
        with hold_claim(file_store, _KEY, ttl_s=_FOREVER_S):
            pass
    with hold_claim_unless_alive(file_store, _KEY) as claim:
        assert claim is not None


def test_a_holder_that_was_replaced_knows_and_leaves_the_claim_alone(file_store: Store) -> None:
    with hold_claim(file_store, _KEY, ttl_s=0.3) as claim:
        while True:
            seen = file_store.get(_KEY)
            try:
                file_store.replace(_KEY, _held_elsewhere(ttl_s=9), seen.etag)
            except ObjectConflict:
                continue
            break
        while not claim.lost:
            time.sleep(0.01)
    assert _record(file_store).owner == "other"


def test_a_holder_whose_claim_was_removed_does_not_bring_it_back(file_store: Store) -> None:
    with hold_claim(file_store, _KEY, ttl_s=_FOREVER_S):
        file_store.delete(_KEY)
    assert not file_store.exists(_KEY)


def test_the_thread_that_holds_a_claim_is_told_so_instead_of_waiting_for_itself(file_store: Store) -> None:
    with (
        hold_claim(file_store, _KEY),
        pytest.raises(StoreError, match="this very thread"),
        hold_claim(file_store, _KEY),
    ):
        pass


def test_claims_of_different_keys_do_not_meet(file_store: Store) -> None:
    with hold_claim(file_store, _KEY), hold_claim(file_store, claim_key("world-generation-job", "wgj-1")) as other:
        assert other.epoch == 1


class _Failing(LocalStore):
    """A store whose replacements fail as told: before they are done, or after."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.away = Event()
        self.lose_next_answer = Event()
        self.beats = 0

    def replace(self, key: str, body: bytes, etag: str) -> str:
        self.beats += 1
        if self.away.is_set():
            raise StoreUnreachable("away")
        after = super().replace(key, body, etag)
        if self.lose_next_answer.is_set():
            self.lose_next_answer.clear()
            raise StoreUnreachable("answer lost")
        return after

    def wait_for_beats(self, number: int) -> None:
        target = self.beats + number
        while self.beats < target:
            time.sleep(0.01)


def test_a_beat_whose_answer_was_lost_does_not_lose_the_claim(tmp_path: Path) -> None:
    failing = _Failing(tmp_path)
    with hold_claim(failing, _KEY, ttl_s=0.3) as claim:
        failing.lose_next_answer.set()
        failing.wait_for_beats(4)
        assert claim.epoch == _record(failing).epoch
    assert _record(failing).released


def test_a_holder_that_cannot_reach_the_store_in_time_has_lost(tmp_path: Path) -> None:
    failing = _Failing(tmp_path)
    with hold_claim(failing, _KEY, ttl_s=0.3) as claim:
        failing.away.set()
        while not claim.lost:
            time.sleep(0.01)
    assert not _record(failing).released


def test_a_store_that_comes_back_in_time_is_no_loss(tmp_path: Path) -> None:
    failing = _Failing(tmp_path)
    with hold_claim(failing, _KEY, ttl_s=3) as claim:
        failing.away.set()
        failing.wait_for_beats(1)
        failing.away.clear()
        failing.wait_for_beats(1)
        assert not claim.lost
    assert _record(failing).released


def test_the_record_names_the_process_that_holds(file_store: Store) -> None:
    with hold_claim(file_store, _KEY):
        assert _record(file_store).process == this_process()


def test_who_waits_is_told_who_holds_the_claim(file_store: Store) -> None:
    file_store.create(_KEY, _held_elsewhere(ttl_s=0.5))
    holders: list[ClaimRecord] = []
    with hold_claim(file_store, _KEY, waiting=holders.append):
        assert {(each.owner, each.process.pid) for each in holders} == {("other", 1)}


def test_a_holder_whose_claim_was_released_on_its_behalf_takes_it_back(file_store: Store) -> None:
    with hold_claim(file_store, _KEY, ttl_s=0.3) as claim:
        released = _record(file_store).model_copy(update={"released": True})
        file_store.put(_KEY, released.model_dump_json().encode())  # as the watch does with one that shows no life
        eventually(lambda: not _record(file_store).released)
        assert not claim.replaced
        assert claim.epoch == 1
