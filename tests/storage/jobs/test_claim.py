"""One live process at a time works on a job, and others see whether it still does."""

import subprocess
import sys
import time
from pathlib import Path
from threading import Event, Thread

import pytest

from specs.errors import ObjectConflict, StoreError, StoreUnreachable
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import UNBOUNDED, Store, StoredObject
from tasks.storage.jobs import claim as claims
from tasks.storage.jobs.claim import (
    ClaimRecord,
    ClaimWatch,
    ProcessIdentity,
    hold_claim,
    hold_claim_unless_alive,
    is_known_dead,
    this_process,
)
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


def test_others_wait_while_a_live_process_holds_the_claim(store: Store) -> None:
    order, looks = list[str](), list[ClaimRecord]()

    def work() -> None:
        with hold_claim(store, _KEY, waiting=looks.append):
            order.append("second")

    waiting = Thread(target=work)
    with hold_claim(store, _KEY):
        waiting.start()
        eventually(lambda: len(looks) > 2)
        order.append("first")
    waiting.join()
    assert order == ["first", "second"]


def test_a_holder_elsewhere_keeps_its_claim_as_long_as_it_beats(file_store: Store) -> None:
    file_store.create(_KEY, _held_elsewhere(ttl_s=0.01))
    seen: list[int] = []

    def beat(found: ClaimRecord) -> None:
        seen.append(found.beat)
        after = found.model_copy(update={"beat": found.beat + 1, "released": found.beat == 20})
        file_store.put(_KEY, after.model_dump_json().encode())

    with hold_claim(file_store, _KEY, waiting=beat) as claim:
        assert (claim.epoch, seen) == (5, list(range(21)))


def test_a_silent_holder_elsewhere_is_replaced_after_its_time(store: Store) -> None:
    store.create(_KEY, _held_elsewhere(ttl_s=0.3))
    with hold_claim(store, _KEY) as claim:
        assert claim.epoch == 5


class _Beating(LocalStore):
    """A store whose holder elsewhere writes its next beat whenever somebody has looked."""

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        found = super().get(key, most_bytes)
        record = ClaimRecord.model_validate_json(found.body)
        self.put(key, record.model_copy(update={"beat": record.beat + 1}).model_dump_json().encode())
        return found


def test_a_holder_elsewhere_that_beats_is_not_waited_for(tmp_path: Path) -> None:
    store = _Beating(tmp_path)
    store.create(_KEY, _held_elsewhere(ttl_s=_FOREVER_S))
    with hold_claim_unless_alive(store, _KEY) as claim:
        assert claim is None
    assert _record(store).epoch == 4


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


def test_a_store_that_comes_back_is_no_loss(tmp_path: Path) -> None:
    failing = _Failing(tmp_path)
    with hold_claim(failing, _KEY, ttl_s=0.3) as claim:
        failing.away.set()
        failing.wait_for_beats(1)
        failing.away.clear()
        failing.wait_for_beats(1)
        eventually(lambda: not claim.lost)
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


KEY = claim_key("world-generation-job", "wgj-0")
ELSEWHERE = ProcessIdentity(host="elsewhere", pid=1, started="1")


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def put(store: Store, beat: int = 0) -> None:
    record = ClaimRecord(owner="other", process=ELSEWHERE, epoch=4, beat=beat, ttl_s=15.0, released=False)
    store.put(KEY, record.model_dump_json().encode())


def found(store: Store) -> ClaimRecord:
    return ClaimRecord.model_validate_json(store.get(KEY).body)


def test_what_nobody_ever_claimed_is_left(file_store: Store) -> None:
    watch = ClaimWatch(file_store, KEY)
    assert watch.is_left()
    assert watch.release()


def test_a_holder_elsewhere_is_given_its_time_to_show_that_it_lives(file_store: Store) -> None:
    put(file_store)
    clock = Clock()
    watch = ClaimWatch(file_store, KEY, clock)
    assert not watch.is_left()
    clock.now_s += 14.9
    assert not watch.is_left()
    clock.now_s += 0.2
    assert watch.is_left()
    assert not watch.renewed


def test_one_that_beats_is_never_left_however_long_it_is_watched(file_store: Store) -> None:
    clock = Clock()
    watch = ClaimWatch(file_store, KEY, clock)
    for beat in range(10):
        put(file_store, beat)
        assert not watch.is_left()
        clock.now_s += 10.0
    assert watch.renewed


def test_a_claim_that_is_left_is_released_with_its_owner_and_epoch(store: Store) -> None:
    put(store)
    clock = Clock()
    watch = ClaimWatch(store, KEY, clock)
    watch.is_left()
    clock.now_s += 15.0
    assert watch.is_left()
    assert watch.release()
    assert (found(store).released, found(store).owner, found(store).epoch) == (True, "other", 4)
    with hold_claim(store, KEY) as claim:
        assert claim.epoch == 5


def test_a_holder_that_renews_it_at_the_last_moment_keeps_its_claim(store: Store) -> None:
    put(store)
    clock = Clock()
    watch = ClaimWatch(store, KEY, clock)
    watch.is_left()
    clock.now_s += 15.0
    assert watch.is_left()
    put(store, beat=1)
    assert not watch.release()
    assert not found(store).released


def test_a_holder_that_slept_through_its_release_finds_itself_replaced_if_another_one_was_faster(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "this_process", lambda: ELSEWHERE)
    clock = Clock()
    with hold_claim(file_store, KEY, ttl_s=100.0) as slept:
        watch = ClaimWatch(file_store, KEY, clock)
        watch.is_left()
        clock.now_s += 100.0
        assert watch.is_left()
        assert watch.release()
        monkeypatch.setattr("tasks.storage.jobs.claim._held", set())  # the other one is another process
        with hold_claim(file_store, KEY) as taken:
            assert taken.epoch == 2
            slept.release()
            assert slept.replaced
            assert found(file_store).owner == taken._record.owner


_TELL = (
    "from tasks.storage.jobs.claim import this_process; print(this_process().model_dump_json(), flush=True); input()"
)


def _child() -> tuple[subprocess.Popen[str], ProcessIdentity]:
    child = subprocess.Popen([sys.executable, "-c", _TELL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    return child, ProcessIdentity.model_validate_json(child.stdout.readline())


def test_a_process_that_runs_is_not_dead() -> None:
    child, identity = _child()
    with child:
        assert not is_known_dead(identity)
        child.kill()


def test_a_killed_process_is_dead_before_and_after_its_parent_notices() -> None:
    child, identity = _child()
    with child:
        child.kill()
        while not is_known_dead(identity):  # the kernel takes a moment; nobody has waited for the child yet
            assert child.returncode is None
    assert is_known_dead(identity)


def test_a_later_process_with_the_same_number_is_not_mistaken() -> None:
    assert is_known_dead(this_process().model_copy(update={"started": "1"}))


def test_of_a_process_on_another_host_nothing_is_known() -> None:
    assert not is_known_dead(ProcessIdentity(host="elsewhere", pid=2**22 + 1, started="1"))


def test_of_a_process_that_could_not_tell_nothing_is_known() -> None:
    assert not is_known_dead(this_process().model_copy(update={"started": ""}))
