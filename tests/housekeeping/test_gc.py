"""What a gc removes and what it keeps."""

from pathlib import Path, PurePosixPath
from typing import cast

import pytest
from pydantic import JsonValue

from specs.errors import StoreAccessDenied
from tasks.housekeeping.gc import Ages
from tasks.storage.base.keys import bundle_key, job_key, tags_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance
from tasks.storage.jobs.runs import stage_token
from tests.housekeeping.yard import NOW, Meddled, Yard, freed, later, results_of, worlds_of
from tests.storage.contracts.test_listing_contract import leave_unfinished

_HOUR_S = 3600.0


def a_batch(yard: Yard) -> tuple[str, str]:
    """Returns the ids of a generation job and of a batch that drove its worlds."""
    generation = yard.generation("worlds")
    version = yard.publish("courier", b"bundle")
    return generation.id, yard.batch("batch", generation.id, version.digest).id


def test_what_records_name_stays(yard: Yard, tmp_path: Path) -> None:
    generation, _ = a_batch(yard)
    yard.export("export", generation)
    before = yard.store.keys("")
    assert freed(yard.gc(tmp_path)) == {}
    assert yard.store.keys("") == before


def test_what_a_batch_without_a_record_left_goes_and_its_worlds_stay(yard: Yard, tmp_path: Path) -> None:
    generation, batch = a_batch(yard)
    yard.store.delete(job_key("simulation-job-batch", batch))
    assert freed(yard.gc(tmp_path)) == {"chunks": 1, "claims": 1, "recordings": 1, "results": 2, "tokens": 1}
    assert not [key for key in yard.store.keys("") if batch in key]
    assert all(yard.store.exists(key) for key in worlds_of(generation))
    assert freed(yard.gc(tmp_path)) == {}


def test_tags_go_with_the_job_that_they_are_of_and_stay_as_long_as_it_is_there(yard: Yard, tmp_path: Path) -> None:
    generation, batch = a_batch(yard)
    world = PurePosixPath(worlds_of(generation)[0]).stem
    of_batch = [tags_key("simulation-job-batch", batch), tags_key("simulation-job", f"{batch}/7")]
    of_generation = [tags_key("world-generation-job", generation), tags_key("world", f"{generation}/{world}")]
    for key in (*of_batch, *of_generation):
        yard.store.put(key, b"{}")
    assert freed(yard.gc(tmp_path)) == {}
    yard.store.delete(job_key("simulation-job-batch", batch))
    assert freed(yard.gc(tmp_path))["tags"] == 2
    assert yard.store.keys("tags") == sorted(of_generation)
    yard.store.delete(job_key("world-generation-job", generation))
    yard.gc(tmp_path)
    assert yard.store.keys("tags") == []


def test_without_being_told_to_nothing_is_removed_or_written(yard: Yard, tmp_path: Path) -> None:
    _, batch = a_batch(yard)
    yard.unpublish("courier")
    yard.store.delete(job_key("simulation-job-batch", batch))
    before = {entry.key: entry.mark for entry in yard.store.entries("")}
    told = yard.gc(tmp_path, remove=False)
    assert {entry.key: entry.mark for entry in yard.store.entries("")} == before
    assert freed(told) == freed(yard.gc(tmp_path)) != {}


def test_evidence_keeps_bundle_worlds_and_results_when_every_record_is_gone(yard: Yard, tmp_path: Path) -> None:
    generation, batch = a_batch(yard)
    digest = yard.publish("courier", b"bundle").digest
    yard.judge(batch, generation, digest)
    yard.unpublish("courier")
    yard.store.delete(job_key("simulation-job-batch", batch))
    yard.store.delete(job_key("world-generation-job", generation))
    assert freed(yard.gc(tmp_path)) == {"chunks": 1}
    kept = [bundle_key(digest), *worlds_of(generation), *results_of(batch)]
    assert all(yard.store.exists(key) for key in kept)


def test_worlds_of_a_lost_job_stay_as_long_as_a_batch_names_them(yard: Yard, tmp_path: Path) -> None:
    generation, batch = a_batch(yard)
    yard.store.delete(job_key("world-generation-job", generation))
    assert freed(yard.gc(tmp_path)) == {}
    yard.store.delete(job_key("simulation-job-batch", batch))
    yard.gc(tmp_path)
    assert yard.store.keys("worlds") == []


def test_a_world_that_somebody_added_stays(yard: Yard, tmp_path: Path) -> None:
    added = [world_key("shrunk", "a"), world_key("wgj-0123456789abcdef", "from-another-store")]
    for key in added:
        yard.store.put(key, b"world")
    assert freed(yard.gc(tmp_path)) == {}
    assert yard.store.keys("worlds") == sorted(added)


def test_what_people_put_into_buckets_stays(yard: Yard, tmp_path: Path) -> None:
    _, batch = a_batch(yard)
    yard.store.delete(job_key("simulation-job-batch", batch))
    theirs = ["buckets/out/data.csv", f"buckets/out/nightly/{batch}/my-notes.txt"]
    for key in theirs:
        yard.store.put(key, b"1")
    yard.gc(tmp_path)
    assert yard.store.keys("buckets") == sorted(theirs)


def test_results_of_another_store_in_a_bucket_of_this_one_stay(yard: Yard, tmp_path: Path) -> None:
    key = "buckets/out/simb-0123456789abcdef/results.parquet"
    yard.store.put(key, b"1")
    yard.gc(tmp_path)
    assert yard.store.exists(key)


def test_a_bundle_goes_when_two_gcs_a_grace_apart_found_no_name_for_it(yard: Yard, tmp_path: Path) -> None:
    key = bundle_key(yard.publish("courier", b"bundle").digest)
    yard.unpublish("courier")
    day = Ages(grace_s=24 * _HOUR_S)
    found: list[bool] = []
    for hours in (30, 53, 55):
        Yard(later(yard.store, hours * _HOUR_S)).gc(tmp_path, day)
        found.append(yard.store.exists(key))
    assert found == [True, True, False]


def test_a_bundle_that_was_published_again_between_two_gcs_begins_anew(yard: Yard, tmp_path: Path) -> None:
    key = bundle_key(yard.publish("courier", b"bundle").digest)
    yard.unpublish("courier")
    day = Ages(grace_s=24 * _HOUR_S)
    Yard(later(yard.store, 30 * _HOUR_S)).gc(tmp_path, day)
    yard.publish("courier", b"bundle")
    yard.unpublish("courier")
    Yard(later(yard.store, 60 * _HOUR_S)).gc(tmp_path, day)
    assert yard.store.exists(key)


@pytest.mark.parametrize("named_by", ["desired", "reported", "deployment"])
def test_a_bundle_that_only_a_robot_or_a_deployment_names_stays(yard: Yard, tmp_path: Path, named_by: str) -> None:
    digest = yard.publish("courier", b"bundle").digest
    yard.unpublish("courier")
    if named_by == "deployment":
        yard.deploy("d", digest)
        yard.store.delete("robots/robot-d/desired.json")
    else:
        name = {"desired": "digest", "reported": "running_digest"}[named_by]
        yard.store.put(f"robots/r/{named_by}.json", f'{{"robot": "r", "{name}": "{digest}"}}'.encode())
    yard.gc(tmp_path)
    assert yard.store.exists(bundle_key(digest))


def test_nothing_younger_than_the_grace_goes_and_that_is_told(yard: Yard, tmp_path: Path) -> None:
    _, batch = a_batch(yard)
    yard.store.delete(job_key("simulation-job-batch", batch))
    before = yard.store.keys("")
    report = yard.gc(tmp_path, Ages(grace_s=_HOUR_S))
    assert (freed(report), yard.store.keys("")) == ({}, before)
    assert {row.kind for row in report.waiting} == {"chunks", "claims", "recordings", "results", "tokens"}
    assert freed(Yard(later(yard.store, 2 * _HOUR_S)).gc(tmp_path, Ages(grace_s=_HOUR_S))) != {}


def test_what_killed_writers_left_goes_once_it_is_old(yard: Yard, tmp_path: Path) -> None:
    leave_unfinished(yard.store, "bundles/left")
    yard.store.put(f"probe/{'0' * 32}", b"1")
    assert freed(yard.gc(tmp_path, Ages(grace_s=_HOUR_S))) == {}
    assert freed(yard.gc(tmp_path)) == {"probes": 1, "unfinished writes": 1}
    assert (yard.store.unfinished(""), yard.store.keys("probe")) == ([], [])


def test_parts_of_an_export_go_when_it_has_ended_and_no_sooner(yard: Yard, tmp_path: Path) -> None:
    generation = yard.generation("worlds").id
    going = yard.export("going", generation, ended=False).id
    ended = yard.export("ended", generation).id
    for job in (going, ended):
        yard.store.put(f"parts/{job}/{generation}/w1.zip", b"zip")
    assert freed(yard.gc(tmp_path)) == {"export parts": 1}
    assert yard.store.keys("parts") == [f"parts/{going}/{generation}/w1.zip"]


def test_ended_jobs_that_nothing_names_are_forgotten_only_when_asked(yard: Yard, tmp_path: Path) -> None:
    generation, batch = a_batch(yard)
    other = yard.generation("unused").id
    going = yard.generation("going", ended=False).id
    old = Ages(grace_s=0.0, ended_s=_HOUR_S)
    assert freed(yard.gc(tmp_path, old)) == {}
    yard.judge(batch, generation, "0" * 64)
    report = Yard(later(yard.store, 2 * _HOUR_S)).gc(tmp_path, old)
    assert freed(report) == {"claims": 1, "job records": 1, "tokens": 1, "worlds": 2}
    left = {key for key in yard.store.keys("") if key.endswith("/w1.json")}
    assert left == {worlds_of(generation)[0], worlds_of(going)[0]}
    assert not yard.store.exists(job_key("world-generation-job", other))


def test_a_run_that_has_not_ended_keeps_what_its_stages_made(yard: Yard, tmp_path: Path) -> None:
    request: JsonValue = {"flow": "pipeline", "spec": {"worldGeneration": {}}}
    run = yard.job("pipeline-run", "run", cast("dict[str, JsonValue]", request), set(), ended=False)
    made = yard.generation(stage_token(run, "worlds"))
    forgetting = Ages(grace_s=0.0, ended_s=0.0)
    assert freed(yard.gc(tmp_path, forgetting)) == {}
    advance(yard.store, run.kind, run.id, "Completed")
    assert freed(yard.gc(tmp_path, forgetting))["worlds"] == len(worlds_of(made.id))


def test_buckets_outside_the_store_are_left_alone_and_told(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert yard.gc(tmp_path).left_out == ()
    monkeypatch.setenv("SIMYARD_BUCKETS", tmp_path.as_uri())
    (told,) = yard.gc(tmp_path).left_out
    assert tmp_path.as_uri() in told


def test_a_server_that_does_not_tell_of_unfinished_writes_is_swept_all_the_same(yard: Yard, tmp_path: Path) -> None:
    def refused() -> None:
        raise StoreAccessDenied("not yours to list")

    yard.lose(yard.generation("lost"))
    store = Meddled(yard.store)
    store.instead("unfinished", "", refused)
    report = Yard(cast("Store", store)).gc(tmp_path)
    assert report.left_out == ("unfinished writes: not yours to list",)
    assert yard.store.keys("worlds") == []


@pytest.mark.parametrize(
    "record",
    [
        "jobs/world-export-job/wej-0123456789abcdef.json",
        "jobs/simulation-job-batch/simb-0123456789abcdef.json",
        "applications/robot-application/other.json",
        "results/simb-0123456789abcdef/evidence.json",
        "robots/r/desired.json",
        "fleets/f.json",
    ],
)
@pytest.mark.parametrize("body", [b"", b"{", b"[]", b"{}", b"\xff\xfe"])
def test_a_spoilt_record_is_named_and_keeps_what_it_might_name(
    yard: Yard, tmp_path: Path, record: str, body: bytes
) -> None:
    digest = yard.publish("courier", b"bundle").digest
    yard.unpublish("courier")
    lost = yard.generation("lost")
    yard.lose(lost)
    yard.store.put(f"probe/{'0' * 32}", b"1")
    yard.store.put(record, body)
    report = yard.gc(tmp_path)
    assert [each.record for each in report.unread] == [record]
    assert yard.store.exists(bundle_key(digest))
    assert yard.store.exists(worlds_of(lost.id)[0]) != record.startswith(("robots/", "fleets/"))
    assert not yard.store.exists(f"probe/{'0' * 32}")


def test_a_job_whose_record_is_spoilt_keeps_what_it_made(yard: Yard, tmp_path: Path) -> None:
    _, batch = a_batch(yard)
    yard.store.put(job_key("simulation-job-batch", batch), b"{")
    before = yard.store.keys("")
    assert freed(yard.gc(tmp_path, remove=False)) == {}
    yard.gc(tmp_path)
    assert yard.store.keys("") == before


def test_no_job_is_forgotten_while_a_record_that_may_name_it_cannot_be_read(yard: Yard, tmp_path: Path) -> None:
    yard.generation("old")
    yard.store.put("fleets/f.json", b"{")
    before = yard.store.keys("")
    forgetting = Ages(grace_s=0.0, ended_s=0.0)
    assert freed(yard.gc(tmp_path, forgetting, remove=False)) == {}
    yard.gc(tmp_path, forgetting)
    assert yard.store.keys("") == before


def test_ages_have_the_defaults_that_the_document_tells() -> None:
    assert (Ages().grace_s, Ages().ended_s, Ages().unused_s) == (24 * _HOUR_S, None, 30 * 24 * _HOUR_S)
    assert NOW.grace_s == 0
