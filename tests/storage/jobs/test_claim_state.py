"""A claim that is looked at and not taken: whether its holder lives, and its release on behalf of one that does not."""

import pytest

from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs import claim as claims
from tasks.storage.jobs.claim import ClaimRecord, ClaimWatch, ProcessIdentity, hold_claim

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
