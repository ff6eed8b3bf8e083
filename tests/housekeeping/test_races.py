"""What others do at the worst moment of a gc."""

from pathlib import Path
from threading import Thread
from typing import cast

import pytest

from specs.errors import StoreError
from tasks.housekeeping.gc import GcReport
from tasks.storage.base.keys import bundle_key, claim_key, job_key, result_key, token_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, hold_claim
from tasks.storage.jobs.records import JobRecord, submit
from tests.factories.lively_claims import hold_lively_claim
from tests.housekeeping.yard import NOW, Meddled, Mortal, Yard, freed, worlds_of


def meddled(yard: Yard) -> tuple[Meddled, Yard]:
    """Returns a store that may be meddled with, and the yard of a gc that runs on it."""
    between = Meddled(yard.store)
    return between, Yard(cast("Store", between))


def unnamed_bundle(yard: Yard) -> str:
    """Returns the digest of a bundle whose version was deleted."""
    digest = yard.publish("courier", b"bundle").digest
    yard.unpublish("courier")
    return digest


def lost_generation(yard: Yard) -> JobRecord:
    """Returns a generation job whose record is gone."""
    lost = yard.generation("lost")
    yard.lose(lost)
    return lost


@pytest.mark.parametrize("moment", ["download", "delete_unchanged"])
def test_a_bundle_that_is_published_again_right_before_its_removal_stays(
    yard: Yard, tmp_path: Path, moment: str
) -> None:
    key = bundle_key(unnamed_bundle(yard))
    between, gc = meddled(yard)
    between.before(moment, key, lambda: yard.publish("courier", b"bundle"))
    assert freed(gc.gc(tmp_path)) == {}
    assert yard.store.get(key).body == b"bundle"


def test_a_bundle_that_is_published_again_where_a_store_cannot_compare_is_put_back(yard: Yard, tmp_path: Path) -> None:
    key = bundle_key(unnamed_bundle(yard))
    between, gc = meddled(yard)

    def published_between_comparing_and_removing() -> bool:
        yard.publish("courier", b"bundle")
        yard.store.delete(key)
        return True

    between.instead("delete_unchanged", key, published_between_comparing_and_removing)
    report = gc.gc(tmp_path)
    assert (freed(report), [row.kind for row in report.stayed]) == ({}, ["bundles"])
    assert yard.store.get(key).body == b"bundle"


def test_a_deployment_that_is_recorded_during_a_gc_keeps_its_bundle(yard: Yard, tmp_path: Path) -> None:
    digest = unnamed_bundle(yard)  # its version was deleted after the deployment had read it
    between, gc = meddled(yard)
    between.before("unfinished", "", lambda: yard.deploy("d", digest))
    report = gc.gc(tmp_path)
    assert [row.kind for row in report.stayed] == ["bundles"]
    assert yard.store.exists(bundle_key(digest))


def test_a_record_that_is_spoilt_during_a_gc_keeps_bundles(yard: Yard, tmp_path: Path) -> None:
    digest = unnamed_bundle(yard)
    between, gc = meddled(yard)
    between.before("unfinished", "", lambda: yard.store.put("robots/r/desired.json", b"{"))
    gc.gc(tmp_path)
    assert yard.store.exists(bundle_key(digest))


def test_a_job_that_is_asked_for_again_during_a_gc_keeps_what_it_made(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    between, gc = meddled(yard)
    between.before(
        "get", claim_key(lost.kind, lost.id), lambda: submit(yard.store, lost.kind, lost.request, lost.token)
    )
    before = yard.store.keys("worlds")
    assert freed(gc.gc(tmp_path)) == {}
    assert yard.store.keys("worlds") == before == worlds_of(lost.id)
    assert yard.store.exists(token_key(lost.kind, lost.token))


def test_who_asks_for_a_job_while_its_token_goes_gets_the_token_back(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    between, gc = meddled(yard)
    token = token_key(lost.kind, lost.token)
    before = yard.store.get(token).body
    between.before("delete_unchanged", token, lambda: submit(yard.store, lost.kind, lost.request, lost.token))
    gc.gc(tmp_path)
    assert yard.store.exists(job_key(lost.kind, lost.id))
    assert yard.store.get(token).body == before


def test_who_asks_for_a_job_after_a_gc_looked_for_its_record_writes_its_token_again(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    token = token_key(lost.kind, lost.token)
    before = yard.store.get(token).body
    between, _ = meddled(yard)
    between.before("create", job_key(lost.kind, lost.id), lambda: yard.gc(tmp_path))
    submit(cast("Store", between), lost.kind, lost.request, lost.token)
    assert yard.store.get(token).body == before


def test_a_claim_that_was_taken_and_left_since_a_gc_released_it_stays(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    key = claim_key(lost.kind, lost.id)
    between, gc = meddled(yard)
    epochs: list[int] = []

    def taken_and_left() -> None:
        submit(yard.store, lost.kind, lost.request, lost.token)
        with hold_claim(yard.store, key) as claim:
            epochs.append(claim.epoch)

    between.before("entry", key, taken_and_left)
    gc.gc(tmp_path)
    with hold_claim(yard.store, key) as claim:
        assert [claim.epoch - 1] == epochs


def test_what_a_live_process_works_on_stays_though_its_record_is_gone(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    with hold_lively_claim(yard.store, claim_key(lost.kind, lost.id)):
        gc = Thread(target=lambda: yard.gc(tmp_path))
        gc.start()
        gc.join()
        assert yard.store.keys("worlds") == worlds_of(lost.id)
    yard.gc(tmp_path)
    assert yard.store.keys("worlds") == []


def test_what_a_job_made_anew_while_a_gc_slept_stays_with_its_token(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    between, gc = meddled(yard)
    first, second = worlds_of(lost.id)
    between.before("delete_unchanged", first, lambda: yard.store.put(second, b"made anew"))
    report = gc.gc(tmp_path)
    assert yard.store.keys("worlds") == [second]
    assert {row.kind for row in report.stayed} == {"worlds", "tokens", "claims"}
    assert yard.store.exists(token_key(lost.kind, lost.token))


def test_a_gc_that_slept_for_too_long_removes_nothing_more(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = lost_generation(yard)
    monkeypatch.setattr(Claim, "lost", property(lambda _claim: True))
    assert freed(yard.gc(tmp_path)) == {}
    assert yard.store.keys("worlds") == worlds_of(lost.id)


def test_worlds_that_a_batch_names_during_a_gc_stay(yard: Yard, tmp_path: Path) -> None:
    lost = lost_generation(yard)
    between, gc = meddled(yard)
    between.before("get", claim_key(lost.kind, lost.id), lambda: yard.batch("b", lost.id, "0" * 64))
    gc.gc(tmp_path)
    assert yard.store.keys("worlds") == worlds_of(lost.id)


def test_results_whose_evidence_is_written_during_a_gc_stay(yard: Yard, tmp_path: Path) -> None:
    batch = yard.batch("b", yard.generation("g").id, "0" * 64)
    yard.lose(batch)
    between, gc = meddled(yard)
    evidence = result_key(batch.id, "evidence.json")
    between.before("get", claim_key(batch.kind, batch.id), lambda: yard.store.put(evidence, b"{}"))
    before = yard.store.keys("buckets")
    gc.gc(tmp_path)
    assert yard.store.keys("buckets") == before


def test_an_old_job_that_is_named_during_a_gc_is_not_forgotten(yard: Yard, tmp_path: Path) -> None:
    old = yard.generation("old")
    between, gc = meddled(yard)
    between.before("get", claim_key(old.kind, old.id), lambda: yard.batch("b", old.id, "0" * 64, ended=False))
    gc.gc(tmp_path, type(NOW)(grace_s=0.0, ended_s=0.0))
    assert yard.store.exists(job_key(old.kind, old.id))
    assert yard.store.keys("worlds") == worlds_of(old.id)


def full_of_leftovers(yard: Yard) -> None:
    """Fills a store with something of each kind that can go, and with a batch that is needed."""
    kept = yard.publish("kept", b"kept").digest
    yard.batch("kept", yard.generation("kept").id, kept)
    generation = yard.generation("lost")
    batch = yard.batch("lost", generation.id, unnamed_bundle(yard))
    export = yard.export("lost", generation.id)
    for record in (generation, batch, export):
        yard.lose(record)
    yard.store.put(f"probe/{'0' * 32}", b"1")


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.soak)])
def test_killed_at_a_write_the_next_gc_leaves_what_an_unbroken_one_does(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int
) -> None:
    # As the one who held them is: killed.
    monkeypatch.setattr("tasks.storage.jobs.claim.is_known_dead", lambda _process: True)
    full_of_leftovers(yard)
    yard.gc(tmp_path)
    stays = yard.store.keys("")
    writes = 0
    while _is_killed(yard, tmp_path, writes):
        yard.gc(tmp_path)
        assert yard.store.keys("") == stays
        writes += every
    assert yard.store.keys("") == stays
    assert writes > 20


def _is_killed(yard: Yard, tmp_path: Path, writes: int) -> bool:
    full_of_leftovers(yard)
    try:
        Yard(cast("Store", Mortal(yard.store, writes))).gc(tmp_path)
    except StoreError:
        return True
    return False


def test_two_gcs_at_once_leave_what_one_does(yard: Yard, tmp_path: Path) -> None:
    full_of_leftovers(yard)
    reports: list[GcReport] = []
    threads = [Thread(target=lambda: reports.append(yard.gc(tmp_path))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(reports) == 2
    yard.gc(tmp_path)
    left = yard.store.keys("")
    assert freed(yard.gc(tmp_path)) == {}
    assert yard.missing({*left, *(key for needs in yard.needs.values() for key in needs)}) == set()
    assert not [key for key in left if key.startswith(("probe/", "buckets/out/some"))]
