"""The reaper: jobs whose worker died are ended if they were being stopped, and else ready to be run on."""

import pytest
from pydantic import JsonValue
from typer.testing import CliRunner

from flows.cli.shell import app
from flows.resources import abandoned_jobs
from flows.resources.abandoned_jobs import ReapedJob, job_notes, kind_notes, reap_jobs
from specs.errors import StoreError
from specs.job_kinds import JobKind
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.batch_record import time_out
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs import claim as claims
from tasks.storage.jobs.claim import ClaimRecord, ProcessIdentity, hold_claim
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.jobs.runs import KIND, begin_run, stage_token
from tests.factories import planned_batches
from tests.factories.lively_claims import hold_lively_claim

ELSEWHERE = ProcessIdentity(host="elsewhere", pid=1, started="1")
SPEC: dict[str, JsonValue] = {"name": "nightly", "worldGeneration": {}}
BATCH: JobKind = "simulation-job-batch"
EXPORT: JobKind = "world-export-job"


class Clock:
    """Seconds that pass while somebody sleeps."""

    def __init__(self) -> None:
        self.passed_s = 0.0

    def now_s(self) -> float:
        return self.passed_s

    def sleep(self, seconds: float) -> None:
        self.passed_s += seconds


def reaped(store: Store) -> dict[str, ReapedJob]:
    clock = Clock()
    return {each.arn: each for each in reap_jobs(store, clock.sleep, clock.now_s)}


def left_by_another_machine(store: Store, kind: JobKind, job: str, beat: int = 0, ttl_s: float = 15.0) -> None:
    holder = ClaimRecord(owner="other", process=ELSEWHERE, epoch=1, beat=beat, ttl_s=ttl_s, released=False)
    store.put(claim_key(kind, job), holder.model_dump_json().encode())


def a_run(store: Store) -> tuple[JobRecord, JobRecord]:
    """A run at its first stage, both claimed by a process on another machine that will never be heard of again."""
    with begin_run(store, {"flow": "pipeline", "spec": SPEC}) as run:
        advance(store, KIND, run.id, "Running")
    job = submit(store, "world-generation-job", {}, stage_token(run, "worlds"))
    left_by_another_machine(store, KIND, run.id)
    left_by_another_machine(store, job.kind, job.id)
    return run, advance(store, job.kind, job.id, "Running")


def continued(arn: str) -> str:
    unless = "if neither document nor applications have changed"
    return f"simyard run of nightly continues it {unless}; simyard cancel {arn} ends it"


def test_what_is_left_is_continued_by_its_document_and_known_to_be_left_at_once(store: Store) -> None:
    run, job = a_run(store)
    assert list(kind_notes(store, "pipeline-runs")) == []  # its process may live, as far as a glance tells
    found = reaped(store)
    assert {arn: (each.was, each.status) for arn, each in found.items()} == {
        run.arn: ("Running", "Running"),
        job.arn: ("Running", "Running"),
    }
    assert {arn: each.meaning for arn, each in found.items()} == {arn: continued(arn) for arn in (run.arn, job.arn)}
    assert list(kind_notes(store, "pipeline-runs")) == [
        f"{run.arn} is Running, and nobody works on it: {continued(run.arn)}"
    ]
    with begin_run(store, {"flow": "pipeline", "spec": SPEC}) as again:
        assert again.id == run.id
        assert list(kind_notes(store, "pipeline-runs")) == []


def test_a_job_whose_run_is_worked_on_is_not_left(file_store: Store) -> None:
    with begin_run(file_store, {"flow": "pipeline", "spec": SPEC}) as run:
        pass
    job = submit(file_store, "world-generation-job", {}, stage_token(run, "worlds"))
    with hold_lively_claim(file_store, claim_key(KIND, run.id)):
        assert reap_jobs(file_store) == []
        assert list(job_notes(file_store, job.arn)) == []


def test_a_holder_elsewhere_that_beats_is_left_alone(file_store: Store) -> None:
    job = submit(file_store, EXPORT, {}, "one")
    left_by_another_machine(file_store, EXPORT, job.id)
    clock, beats = Clock(), iter(range(1, 99))

    def sleep(seconds: float) -> None:
        clock.sleep(seconds)
        left_by_another_machine(file_store, EXPORT, job.id, next(beats))

    assert reap_jobs(file_store, sleep, clock.now_s) == []


def test_a_holder_that_slept_goes_on_with_its_claim_after_the_reaper_was_there(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = submit(file_store, EXPORT, {}, "one")
    monkeypatch.setattr(claims, "this_process", lambda: ELSEWHERE)
    with hold_claim(file_store, claim_key(EXPORT, job.id), ttl_s=30.0) as claim:
        assert [each.status for each in reaped(file_store).values()] == ["Pending"]
        claim._write(claim._record)  # its next heartbeat
        assert not claim.replaced
        assert list(job_notes(file_store, job.arn)) == []


def test_a_job_that_was_being_cancelled_ends_canceled(file_store: Store) -> None:
    job = submit(file_store, EXPORT, {}, "one")
    advance(file_store, EXPORT, job.id, "Canceling")
    left_by_another_machine(file_store, EXPORT, job.id)
    clock = Clock()
    file_store.delete(claim_key(EXPORT, job.id))
    assert [each.status for each in reap_jobs(file_store, clock.sleep, clock.now_s)] == ["Canceled"]


def test_a_deployment_that_was_being_cancelled_ends_canceled(file_store: Store) -> None:
    job = submit(file_store, "deployment-job", {}, "one")
    advance(file_store, job.kind, job.id, "InProgress", detail={"canceled": True})
    assert reaped(file_store)[job.arn].status == "Canceled"


@pytest.mark.parametrize("end", ["Canceled", "TimedOut"])
def test_a_batch_that_was_being_stopped_comes_to_that_end_with_the_rows_of_what_was_done(
    file_store: Store, end: str
) -> None:
    batch = planned_batches.begun(file_store, planned_batches.plan(file_store, lanes=2))
    run_chunk(batch, 0, planned_batches.all_pass, lanes=2, left_s=3600.0)
    if end == "TimedOut":
        time_out(batch)
    else:
        cancel_batch(file_store, batch.id)
    assert reaped(file_store)[batch.record().arn].status == end
    assert batch.record().detail["episodes"] == 6


def test_a_job_whose_run_has_ended_is_canceled_because_nothing_will_continue_it(file_store: Store) -> None:
    with begin_run(file_store, {"flow": "pipeline", "spec": SPEC}) as run:
        advance(file_store, KIND, run.id, "Failed")
    job = submit(file_store, "world-generation-job", {}, stage_token(run, "worlds"))
    assert reaped(file_store)[job.arn].status == "Canceled"
    assert read(file_store, KIND, run.id).status == "Failed"


def test_the_job_of_a_request_of_ones_own_is_continued_by_that(file_store: Store) -> None:
    job = submit(file_store, EXPORT, {}, "one")
    assert reaped(file_store)[job.arn].meaning == "the same request continues it"


def test_nothing_is_said_of_what_is_no_job(file_store: Store) -> None:
    assert list(job_notes(file_store, "arn:simyard:world:0:g/w")) == []
    assert list(kind_notes(file_store, "worlds")) == []


def test_describe_tells_of_a_run_that_nobody_works_on(file_store: Store) -> None:
    with begin_run(file_store, {"flow": "pipeline", "spec": SPEC}) as run:
        pass
    told = CliRunner().invoke(app, ["describe", run.arn, "--store", file_store.url])
    assert told.exit_code == 0, told
    assert told.stderr == f"{run.arn} is Pending, and nobody works on it: {continued(run.arn)}\n"


def test_a_job_that_cannot_be_reaped_does_not_keep_others_from_it(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, sound = (a_left_export(file_store, name) for name in ("broken", "sound"))
    cancel = abandoned_jobs.cancel_resource

    def failing(store: Store, arn: str) -> None:
        if arn == broken.arn:
            raise StoreError("its bucket is gone")
        cancel(store, arn)

    monkeypatch.setattr(abandoned_jobs, "cancel_resource", failing)
    found = reaped(file_store)
    assert "its bucket is gone" in found[broken.arn].meaning
    assert found[broken.arn].status == "Canceling"
    assert found[sound.arn].status == "Canceled"


def test_a_token_that_looks_like_a_runs_and_is_none_leaves_its_job_to_its_request(file_store: Store) -> None:
    job = submit(file_store, EXPORT, {}, "run-0123456789abcdef-export")
    left_by_another_machine(file_store, EXPORT, job.id)
    assert reaped(file_store)[job.arn].status == "Pending"


def a_left_export(store: Store, name: str) -> JobRecord:
    job = submit(store, EXPORT, {}, name)
    left_by_another_machine(store, EXPORT, job.id, ttl_s=1.0)  # a cancellation really waits for it
    return advance(store, EXPORT, job.id, "Canceling")


def outdated_run(store: Store) -> tuple[JobRecord, JobRecord]:
    """A run that was abandoned with its job, and whose document was then changed and has run to its end."""
    with begin_run(store, {"flow": "pipeline", "spec": SPEC}) as run:
        advance(store, KIND, run.id, "Running")
    job = submit(store, "world-generation-job", {}, stage_token(run, "worlds"))
    with begin_run(store, {"flow": "pipeline", "spec": {**SPEC, "worldExport": {}}}) as newer:
        advance(store, KIND, newer.id, "Completed")
    return run, job


def test_runs_of_a_document_that_has_ended_in_another_form_since_are_only_counted(file_store: Store) -> None:
    run, job = outdated_run(file_store)
    why = "of a document that was changed and has ended since: simyard reap --outdated cancels it"
    for kind in ("pipeline-run", "world-generation-job"):
        assert list(kind_notes(file_store, f"{kind}s")) == [f"1 abandoned {kind}, {why}"]
    (told,) = job_notes(file_store, run.arn)
    assert told.endswith("nightly was changed and has ended since; simyard cancel, or reap --outdated, ends this one")
    assert next(job_notes(file_store, job.arn)).endswith("ends this one")


def test_a_run_of_another_document_or_one_that_goes_on_outdates_nothing(file_store: Store) -> None:
    with begin_run(file_store, {"flow": "pipeline", "spec": SPEC}) as run:
        advance(file_store, KIND, run.id, "Running")
    with begin_run(file_store, {"flow": "pipeline", "spec": {**SPEC, "name": "weekly"}}) as other:
        advance(file_store, KIND, other.id, "Completed")
    with begin_run(file_store, {"flow": "pipeline", "spec": {**SPEC, "worldExport": {}}}) as newer:
        advance(file_store, KIND, newer.id, "Running")
        (told,) = kind_notes(file_store, "pipeline-runs")
    assert told.endswith(continued(run.arn))


def test_reap_cancels_outdated_runs_only_if_asked(file_store: Store) -> None:
    run, job = outdated_run(file_store)
    assert {each.status for each in reaped(file_store).values()} == {"Running", "Pending"}
    told = CliRunner().invoke(app, ["reap", "--outdated", "--store", file_store.url])
    assert told.exit_code == 0, told
    assert f"{run.arn}  Running -> Canceled" in told.stdout
    assert read(file_store, KIND, run.id).status == read(file_store, job.kind, job.id).status == "Canceled"
    assert list(kind_notes(file_store, "pipeline-runs")) == []
