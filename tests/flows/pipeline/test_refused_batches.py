"""A batch whose bundles or whose output bucket cannot be used ends, and its jobs say RoboMaker's code."""

import pickle

import pytest

from flows.pipeline.batch_run import run_batch
from specs.errors import StageFailed, StoreAway
from specs.field_types import OutputLocation
from specs.robomaker.bundle import ApplicationKind
from tasks.applications.registry import pack, publish_bundle
from tasks.simulate.batch.batch_jobs import cancel_batch, describe_batch, describe_job
from tasks.simulate.batch.batch_record import OpenBatch, close_refused
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.simulate.batch.chunk_store import begin_chunk, committed_chunk
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tests.factories.planned_batches import all_pass, begun, plan, template
from tests.factories.simulations import COURIER, DELIVERY, FOLDERS, ROBOT, SCENARIO
from tests.servers.seaweed import READER_KEY, READER_SECRET, Seaweed

RESULTS = OutputLocation(s3Bucket="results")
KINDS: tuple[ApplicationKind, ApplicationKind] = ("robot-application", "simulation-application")


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path_factory.mktemp("cache")))


def of_published(store: Store) -> OpenBatch:
    """Returns a batch of published bundles that is in progress."""
    robot = publish_bundle(store, KINDS[0], "courier", FOLDERS[COURIER])
    scenario = publish_bundle(store, KINDS[1], "delivery", FOLDERS[DELIVERY])
    launched = template(
        robot=ROBOT.model_copy(update={"digest": robot.digest}),
        scenario=SCENARIO.model_copy(update={"digest": scenario.digest}),
    )
    return begun(store, plan(store, templates=(launched,), audit=0))


def without_bundles(store: Store) -> OpenBatch:
    """Returns a batch whose jobs all fail at once, because its bundles are gone."""
    return begun(store, plan(store, audit=0))


def codes(batch: OpenBatch) -> set[str]:
    return {row.failure_code for row in committed_chunk(batch.store, batch.id, 0) or ()}


@pytest.mark.parametrize(
    ("at", "code"), [(0, "InvalidBundleRobotApplication"), (1, "InvalidBundleSimulationApplication")]
)
@pytest.mark.parametrize("spoil", ["removed", "changed"])
def test_jobs_whose_bundle_is_gone_or_changed_say_so_and_what_to_do(file_store: Store, at: int, code: str, spoil: str):
    batch = of_published(file_store)
    digest = list(batch.plan.digests())[at]
    if spoil == "removed":
        file_store.delete(bundle_key(digest))
    else:
        file_store.put(bundle_key(digest), pack(FOLDERS[COURIER]) + b"\0" * 512)

    record = run_batch(file_store, batch.id, RESULTS)

    assert record.status == "Completed"
    job = describe_job(file_store, f"{batch.id}/0")
    assert (job.status, job.failureCode) == ("Failed", code)
    name = ("courier", "delivery")[at]
    assert f"the bundle of {name} version 1 is not" in (job.failureReason or "")
    assert f"simyard app publish {name} FOLDER" in (job.failureReason or "")
    assert codes(batch) == {code}


def test_an_output_bucket_that_must_not_be_written_ends_the_batch_and_its_jobs_say_why(
    file_store: Store, seaweed: Seaweed, monkeypatch: pytest.MonkeyPatch
):
    batch = without_bundles(file_store)
    for name, value in {**seaweed.environment(), "SIMYARD_BUCKETS": "s3://"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", READER_KEY)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", READER_SECRET)

    with pytest.raises(StageFailed, match=r"BadPermissionsS3Output: the output bucket tests .* run the document again"):
        run_batch(file_store, batch.id, OutputLocation(s3Bucket="tests"))

    answer = describe_batch(file_store, batch.id)
    assert (answer.status, answer.failureCode) == ("Failed", "InternalServiceError")
    assert (answer.failureReason or "").startswith("BadPermissionsS3Output: ")


def test_jobs_whose_output_was_refused_failed_whatever_they_did(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    batch = without_bundles(file_store)
    run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
    begin_chunk(file_store, batch.id, 1, 0.0)

    close_refused(batch, StageFailed("BadPermissionsS3Output", "the bucket refuses"))

    found = [describe_job(file_store, f"{batch.id}/{index}") for index in (0, 4)]
    assert [(job.status, job.failureCode) for job in found] == [("Failed", "BadPermissionsS3Output")] * 2
    assert [job.failureReason for job in found] == ["BadPermissionsS3Output: the bucket refuses"] * 2


def test_requests_that_never_became_jobs_say_why_too(file_store: Store):
    batch = without_bundles(file_store)

    close_refused(batch, StageFailed("BadPermissionsS3Output", "the bucket refuses"))

    assert {each.failureCode for each in describe_batch(file_store, batch.id).failedRequests or ()} == {
        "BadPermissionsS3Output"
    }


def test_a_code_that_no_job_has_is_an_internal_error_of_its_jobs(file_store: Store):
    batch = without_bundles(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)

    close_refused(batch, StageFailed("Canceled", "stopped"))

    assert describe_job(file_store, f"{batch.id}/0").failureCode == "InternalServiceError"


def test_a_batch_that_is_being_canceled_ends_canceled_though_its_output_is_refused(file_store: Store):
    batch = without_bundles(file_store)
    cancel_batch(file_store, batch.id)

    assert close_refused(batch, StageFailed("BadPermissionsS3Output", "no")).status == "Canceled"


def test_a_batch_whose_bucket_is_away_can_be_continued(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    batch = without_bundles(file_store)

    def away(*_: object) -> Store:
        raise StoreAway("no answer")

    with monkeypatch.context() as broken:
        broken.setattr("tasks.results.tables.result_files.open_bucket", away)
        with pytest.raises(StoreAway):
            run_batch(file_store, batch.id, RESULTS)
        assert batch.record().status == "Completing"

    assert run_batch(file_store, batch.id, RESULTS).status == "Completed"


def test_a_failed_stage_comes_back_whole_from_a_worker():
    failed = pickle.loads(pickle.dumps(StageFailed("MismatchedEtag", "why", "arn")))  # noqa: S301 - our own

    assert (failed.code, failed.reason, failed.arn, str(failed)) == (
        "MismatchedEtag",
        "why",
        "arn",
        "MismatchedEtag: why (arn)",
    )
