"""RoboMaker's answers about batches and jobs, while a batch runs and after it."""

import json
import os
from pathlib import Path
from typing import cast

import pytest
from pydantic import JsonValue

from flows.resources.kinds import restart_named_job
from specs.data.episode import EpisodeResult, unfinished_result
from specs.data.outcomes import OUTCOME, REASON
from specs.errors import DocumentError, ResourceNotFound
from specs.field_types import Filter
from specs.robomaker.simulation import (
    CreateSimulationJobRequest,
    DataSourceConfig,
    ListSimulationJobBatchesRequest,
    ListSimulationJobsRequest,
)
from specs.robomaker.simulation_descriptions import DescribeSimulationJobResponse
from tasks.simulate.batch import batch_jobs
from tasks.simulate.batch.batch_jobs import (
    Jobs,
    batch_describe_jobs,
    batch_notes,
    cancel_batch,
    cancel_job,
    describe_batch,
    describe_job,
    restart_job,
)
from tasks.simulate.batch.batch_record import KIND, OpenBatch, close_batch, complete, load_batch, open_batch, time_out
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import begin_chunk, committed_chunk
from tasks.simulate.batch.job_lists import list_batches, list_batches_page, list_jobs, list_jobs_page
from tasks.simulate.data.mounts import pin_source
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import advance
from tests.factories.episodes import passed
from tests.factories.planned_batches import ROBOT_ARN, all_pass, begun, mixed, plan, request, template

_APPLICATIONS = {"robotApplications", "simulationApplications"}


@pytest.fixture
def running(file_store: Store) -> OpenBatch:
    """Twelve jobs in three chunks: the first is committed, the second begun; the last job of a chunk crashed."""
    made = plan(
        file_store, seeds=tuple(range(3)), sweep={"SPEED": ("1", "2")}, templates=(template(environment={"A": "b"}),)
    )
    batch = begun(file_store, made)
    run_chunk(batch, 0, mixed, lanes=4, left_s=3600.0)
    begin_chunk(file_store, batch.id, 1, 0.0)
    return batch


def written_later(batch: OpenBatch, name: str, by_s: float) -> None:
    """Lets an object of a batch's chunks have been written so much later."""
    path = Path(batch.store.url.removeprefix("file://"), f"chunks/{batch.id}/{name}.json")
    at_s = path.stat().st_mtime + by_s
    os.utime(path, (at_s, at_s))


def test_while_it_runs_jobs_are_created_or_pending(running: OpenBatch):
    answer = describe_batch(running.store, running.id)
    assert answer.status == "InProgress"
    assert [job.status for job in answer.createdRequests or ()] == [
        *["Completed"] * 3, "Failed", *["Running"] * 4
    ]  # fmt: skip
    assert answer.failedRequests == ()
    pending = answer.pendingRequests or ()
    assert len(pending) == 4
    assert pending[0].robotApplications
    assert pending[0].simulationApplications
    robot, scenario = pending[0].robotApplications[0], pending[0].simulationApplications[0]
    assert (robot.application, robot.applicationVersion) == (ROBOT_ARN, "1")
    assert robot.launchConfig.environmentVariables == {"A": "b", "SPEED": "1"}
    assert [str(config.world).rpartition(":")[2] for config in scenario.worldConfigs or ()] == ["g/w1"]


def test_the_list_of_batches_counts_them(running: OpenBatch):
    (line,) = list_batches(running.store)
    counts = (line.pendingRequestCount, line.createdRequestCount, line.failedRequestCount)
    assert (counts, line.status) == ((4, 8, 0), "InProgress")
    time_out(running)
    close_batch(running.store, running.id, "TimedOut", {})
    (line,) = list_batches(running.store)
    assert (line.pendingRequestCount, line.createdRequestCount, line.failedRequestCount) == (0, 8, 4)


@pytest.mark.parametrize(
    ("status", "code"),
    [("TimedOut", "BatchTimedOut"), ("Canceled", "BatchCanceled"), ("Failed", "InternalServiceError")],
)
def test_what_was_never_begun_never_became_a_job(running: OpenBatch, status: str, code: str):
    close_batch(running.store, running.id, status, {}, "the reason")
    answer = describe_batch(running.store, running.id)
    assert answer.pendingRequests is None
    assert len(answer.createdRequests or ()) == 8
    failed = answer.failedRequests or ()
    assert {(each.failureCode, each.failureReason) for each in failed} == {(code, "the reason")}
    assert all(each.request and each.request.maxJobDurationInSeconds == 60 and each.failedAt for each in failed)
    lost = f"{running.id}/11"
    for ask in (describe_job, cancel_job, restart_job):
        with pytest.raises(ResourceNotFound, match=rf"never became a job \({code}: the reason\).*failedRequests"):
            ask(running.store, lost)
    arns = [str(answer.arn).replace("-batch:", ":") + f"/{index}" for index in (3, 11)]
    found = batch_describe_jobs(running.store, arns)
    assert [job.arn for job in found.jobs or ()] == arns[:1]
    assert found.unprocessedJobs == (arns[1],)


def test_a_single_job_that_ended_before_it_began_is_a_job_all_the_same(file_store: Store):
    made = plan(file_store, worlds=("g/w0",), seeds=(0,), lanes=16)
    (entry,) = cast("list[dict[str, JsonValue]]", request(made)["createSimulationJobRequests"])
    asked: dict[str, JsonValue] = {**entry, "iamRole": "arn:aws:iam::1:role/r", "maxJobDurationInSeconds": 400}
    batch = load_batch(file_store, open_batch(file_store, made, asked, "tok").id)
    cancel_batch(file_store, batch.id)
    close_batch(file_store, batch.id, "Canceled", {})
    assert describe_job(file_store, f"{batch.id}/0").status == "Canceled"


def test_a_job_was_last_updated_when_something_happened_to_it(running: OpenBatch):
    def updated() -> list[float]:
        shown = {str(job.name): job.lastUpdatedAt for job in list_jobs(running.store)}
        found = [describe_job(running.store, f"{running.id}/{index}") for index in range(12)]
        assert all(shown.get(str(job.name), job.lastUpdatedAt) == job.lastUpdatedAt for job in found)
        return [job.lastUpdatedAt or 0.0 for job in found]

    created_s = running.record().created_at_s
    written_later(running, "000000", 50)
    written_later(running, "000001.started", 20)
    first = updated()
    assert [len(set(first[start : start + 4])) for start in (0, 4, 8)] == [1, 1, 1]
    assert first[0] > first[4] + 20 > created_s + 40
    assert first[11] == created_s
    restart_job(running.store, f"{running.id}/5")
    cancel_job(running.store, f"{running.id}/11")
    written_later(running, "000001.started", -70)
    after = updated()
    assert after[5] > after[4]
    assert after[11] > created_s
    assert after[:4] == first[:4]


def test_a_job_says_when_it_was_updated_in_a_batch_that_was_copied(running: OpenBatch):
    close_batch(running.store, running.id, "Failed", {})
    written_later(running, "000000", 3600)
    assert describe_job(running.store, f"{running.id}/0").lastUpdatedAt == running.record().updated_at_s


def test_a_reason_of_many_lines_is_answered_as_one(file_store: Store):
    batch = begun(file_store)

    def verbose(part: ChunkPart) -> list[EpisodeResult]:
        rows = all_pass(part)
        failed = unfinished_result(
            rows[0].index,
            "Failed",
            failure_code="RobotApplicationCrash",
            failure_reason="Traceback:\n" + "x" * 2000,
        )
        return [failed, *rows[1:]]

    run_chunk(batch, 0, verbose, lanes=4, left_s=3600.0)
    reason = describe_job(file_store, f"{batch.id}/0").failureReason or ""
    assert reason.startswith("Traceback: xxx")
    assert len(reason) == 1024


def test_a_batch_that_is_complete_has_created_jobs_only(file_store: Store):
    batch = begun(file_store)
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, all_pass, lanes=4, left_s=3600.0)
    complete(batch)
    close_batch(file_store, batch.id, "Completed", {})
    answer = describe_batch(file_store, batch.id)
    assert (answer.status, answer.pendingRequests, answer.failedRequests) == ("Completed", None, ())
    assert {job.status for job in answer.createdRequests or ()} == {"Completed"}


def test_a_failed_job_under_continue_is_kept_until_the_batch_ends(file_store: Store):
    batch = begun(file_store, plan(file_store, templates=(template(), template(failure_behavior="Continue"))))
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, mixed, lanes=4, left_s=3600.0)
    jobs = [f"{batch.id}/{index}" for index in (3, 11)]
    before = [describe_job(file_store, job) for job in jobs]
    assert [job.status for job in before] == ["Failed", "RunningFailed"]
    assert [job.failureCode for job in before] == ["RobotApplicationCrash"] * 2
    close_batch(file_store, batch.id, "Completed", {})
    assert [describe_job(file_store, job).status for job in jobs] == ["Failed", "Failed"]


def test_a_job_says_when_it_began_how_long_it_took_and_what_was_asked(running: OpenBatch):
    job = describe_job(running.store, f"{running.id}/3")
    assert (job.status, job.failureCode) == ("Failed", "RobotApplicationCrash")
    assert job.failureReason == "the controller returned a control that is no number"
    assert (job.simulationTimeMillis, job.maxJobDurationInSeconds) == (31_500, 60)
    assert job.lastStartedAt
    pending = describe_job(running.store, f"{running.id}/11")
    assert (pending.status, pending.lastStartedAt, pending.simulationTimeMillis) == ("Pending", None, None)


def test_the_outcome_of_a_job_is_told_in_tags_once_it_has_ended(file_store: Store):
    batch = begun(file_store)
    assert Jobs(file_store, batch.id).outcome_tags(0) == {}
    run_chunk(batch, 0, mixed, lanes=4, left_s=3600.0)
    found = [Jobs(file_store, batch.id).outcome_tags(index) for index in range(5)]
    assert found[0] == {OUTCOME: "Passed"}
    assert found[1] == {OUTCOME: "Failed", REASON: "collision"}
    assert found[3] == {OUTCOME: "Failed", REASON: "RobotApplicationCrash"}
    assert found[4] == {}
    jobs = batch_describe_jobs(file_store, [f"{batch.id}/0", f"{batch.id}/4"]).jobs or ()
    assert [job.tags for job in jobs] == [{OUTCOME: "Passed"}, None]


def test_a_cancelled_job_has_no_outcome_and_one_that_could_not_begin_has_failed(file_store: Store):
    stopped, failed = begun(file_store), begun(file_store, name="other")
    advance(file_store, KIND, stopped.id, "Canceled")
    advance(file_store, KIND, failed.id, "Failed", failure_code="InternalServiceError")
    assert Jobs(file_store, stopped.id).outcome_tags(0) == {}
    assert Jobs(file_store, failed.id).outcome_tags(0) == {OUTCOME: "Failed", REASON: "InternalServiceError"}


def test_a_single_job_answers_with_all_that_was_asked_of_it(file_store: Store):
    made = plan(file_store, worlds=("g/w0",), seeds=(0,), lanes=16)
    (entry,) = cast("list[dict[str, JsonValue]]", request(made)["createSimulationJobRequests"])
    source: dict[str, JsonValue] = {"name": "maps", "s3Bucket": "data", "s3Keys": ["a.yaml"], "type": "File"}
    asked: dict[str, JsonValue] = {
        **entry,
        "clientRequestToken": "tok",
        "iamRole": "arn:aws:iam::1:role/r",
        "maxJobDurationInSeconds": 1_209_600,
        "outputLocation": {"s3Bucket": "mine", "s3Prefix": "p"},
        "loggingConfig": {"recordAllRosTopics": True},
        "vpcConfig": {"subnets": ["s-1"], "assignPublicIp": True},
        "compute": {"simulationUnitLimit": 4, "computeType": "CPU"},
        "tags": {"Region": "North"},
        "dataSources": [source],
    }
    CreateSimulationJobRequest.model_validate(asked)
    batch = load_batch(file_store, open_batch(file_store, made, asked, "tok").id)
    assert describe_batch(file_store, batch.id).pendingRequests is None
    run_chunk(batch, 0, mixed, lanes=16, left_s=3600.0)
    job = describe_job(file_store, f"{batch.id}/0").model_dump(mode="json", exclude_none=True)
    told_otherwise = {"dataSources", "tags", *_APPLICATIONS}
    assert {key: job[key] for key in asked if key not in told_otherwise} == {
        key: value for key, value in asked.items() if key not in told_otherwise
    }
    assert job["tags"] == {"Region": "North", OUTCOME: "Failed", REASON: "RobotApplicationCrash"}
    assert job["dataSources"][0]["s3Keys"] == [{"s3Key": "a.yaml"}]
    assert job["simulationApplications"][0]["worldConfigs"][0]["world"].endswith(":g/w0")
    missing = DescribeSimulationJobResponse.model_fields.keys() - job.keys()
    assert missing == {"networkInterface"}
    (line,) = list_jobs(file_store)
    assert (line.dataSourceNames, line.computeType) == (("maps",), "CPU")


def test_a_job_says_which_content_of_its_files_it_read(file_store: Store, tmp_path: Path):
    bucket = open_bucket(file_store, "maps-bucket")
    bucket.put("maps/one.yaml", b"walls: []\n")
    asked: list[dict[str, JsonValue]] = [
        {"name": "maps", "s3Bucket": "maps-bucket", "s3Keys": ["maps/one.yaml"], "type": "File"},
        {"name": "all", "s3Bucket": "maps-bucket", "s3Keys": ["maps/"], "type": "Prefix"},
    ]
    pinned = [pin_source(file_store, tmp_path / "cache", DataSourceConfig.model_validate(each)) for each in asked]
    made = plan(file_store, data_sources={each.digest: each for each in pinned})
    document = request(made)
    cast("list[dict[str, JsonValue]]", document["createSimulationJobRequests"])[0]["dataSources"] = [*asked]
    batch = load_batch(file_store, open_batch(file_store, made, document, "tok").id)

    answered = describe_job(file_store, f"{batch.id}/0").dataSources or ()

    found = [(file.s3Key, file.etag) for each in answered for file in each.s3Keys or ()]
    assert found == [("maps/one.yaml", bucket.etag("maps/one.yaml").strip('"')), ("maps/", None)]
    assert "etag" not in json.dumps(batch.record().request)


def test_several_jobs_are_described_and_those_that_are_not_are_named(running: OpenBatch):
    sound = [str(job.arn) for job in list_jobs(running.store)][:2]
    wrong = ["arn:simyard:simulation-job:0:simb-0/0", f"{sound[0]}9", "arn:simyard:world:0:g/w0", "arn:aws:s3:::x/y"]
    answer = batch_describe_jobs(running.store, [wrong[0], sound[1], *wrong[1:], sound[0]])
    assert [job.arn for job in answer.jobs or ()] == [sound[1], sound[0]]
    assert list(answer.unprocessedJobs or ()) == wrong


@pytest.mark.parametrize("index", ["12", "-1", "", "x", "03"])
def test_a_job_that_does_not_exist_is_told_which_do(running: OpenBatch, index: str):
    with pytest.raises(ResourceNotFound, match=f"{running.id}/0 to {running.id}/11"):
        describe_job(running.store, f"{running.id}/{index}")


def test_pages_together_are_the_list(running: OpenBatch):
    begun_too = begun(running.store, name="other")
    run_chunk(begun_too, 1, all_pass, lanes=4, left_s=3600.0)
    found: list[str] = []
    token = None
    for _ in range(10):
        page = list_jobs_page(running.store, ListSimulationJobsRequest(maxResults=3, nextToken=token))
        assert len(page.simulationJobSummaries) <= 3
        found += [str(job.arn) for job in page.simulationJobSummaries]
        token = page.nextToken
        if token is None:
            break
    assert found == [str(job.arn) for job in list_jobs(running.store)]
    assert len(found) == 8 + 2


def test_pages_of_batches_together_are_their_list(running: OpenBatch):
    store = running.store
    others = [begun(store, name=f"other-{number}").id for number in range(4)]
    cancel_batch(store, others[1])
    found: list[str | None] = []
    token = None
    for _ in range(10):
        page = list_batches_page(store, ListSimulationJobBatchesRequest(maxResults=2, nextToken=token))
        found += [batch.arn for batch in page.simulationJobBatchSummaries or ()]
        token = page.nextToken
        if token is None:
            break
    assert found == [batch.arn for batch in list_batches(store)]
    assert len(found) == 5
    canceling = ListSimulationJobBatchesRequest(filters=(Filter(name="status", values=("Canceling",)),))
    only = [str(batch.arn) for batch in list_batches_page(store, canceling).simulationJobBatchSummaries or ()]
    assert [arn.rpartition(":")[2] for arn in only] == [others[1]]
    with pytest.raises(DocumentError, match="nextToken"):
        list_batches_page(store, ListSimulationJobBatchesRequest(nextToken="simb-0"))
    with pytest.raises(DocumentError, match="colour"):
        list_batches_page(store, ListSimulationJobBatchesRequest(filters=(Filter(name="colour", values=("red",)),)))


def test_filters_are_alternatives(running: OpenBatch):
    def names(*filters: Filter) -> list[str]:
        page = list_jobs_page(running.store, ListSimulationJobsRequest(filters=filters))
        return [str(job.name).rpartition("-")[2] for job in page.simulationJobSummaries]

    assert names(Filter(name="status", values=("Failed",))) == ["3"]
    either = names(Filter(name="status", values=("Failed",)), Filter(name="status", values=("Running",)))
    assert either == ["3", "4", "5", "6", "7"]
    assert names(Filter(name="robotApplicationName", values=("nobody",))) == []
    with pytest.raises(DocumentError, match="colour"):
        names(Filter(name="colour", values=("red",)))
    with pytest.raises(DocumentError, match="nextToken"):
        list_jobs_page(running.store, ListSimulationJobsRequest(nextToken="elsewhere"))


def test_a_batch_of_more_jobs_than_robomaker_had_shows_all_of_them(file_store: Store):
    batch = begun(file_store, plan(file_store, seeds=tuple(range(1500)), lanes=1200, worlds=("g/w0",)))
    assert len(describe_batch(file_store, batch.id).pendingRequests or ()) == 1500
    begin_chunk(file_store, batch.id, 0, 0.0)
    answer = describe_batch(file_store, batch.id)
    assert (len(answer.pendingRequests or ()), len(answer.createdRequests or ())) == (300, 1200)
    assert list(batch_notes(file_store, str(answer.arn))) == []


def test_a_batch_of_more_jobs_than_an_answer_holds_says_so(file_store: Store):
    batch = begun(file_store, plan(file_store, seeds=tuple(range(10_001)), lanes=10_100, worlds=("g/w0",)))
    begin_chunk(file_store, batch.id, 0, 0.0)
    answer = describe_batch(file_store, batch.id)
    assert len(answer.createdRequests or ()) == 10_000
    (note,) = batch_notes(file_store, str(answer.arn))
    assert note == (
        f"createdRequests has the first 10,000 of 10,001: simyard list simulation-jobs shows all jobs, "
        f"{batch.id}/0 to {batch.id}/10000"
    )
    assert list(batch_notes(file_store, "arn:simyard:world:0:g/w0")) == []


def test_only_what_has_not_ended_can_be_cancelled(running: OpenBatch):
    store = running.store
    with pytest.raises(DocumentError, match="this one is Failed"):
        cancel_job(store, f"{running.id}/3")
    with pytest.raises(ResourceNotFound):
        cancel_job(store, f"{running.id}/12")
    cancel_job(store, f"{running.id}/4")
    cancel_batch(store, running.id)
    assert cancel_batch(store, running.id).status == "Canceling"
    with pytest.raises(DocumentError, match="in a batch that is Canceling"):
        cancel_job(store, f"{running.id}/5")
    close_batch(store, running.id, "Canceled", {})
    with pytest.raises(DocumentError, match="this one is Canceled"):
        cancel_batch(store, running.id)


def test_a_job_that_completes_while_it_is_being_cancelled_cannot_be_cancelled(
    running: OpenBatch, monkeypatch: pytest.MonkeyPatch
):
    def after_its_end(*arguments: object, **more: object) -> object:
        monkeypatch.undo()
        run_chunk(running, 1, all_pass, lanes=4, left_s=3600.0)
        return advance(*arguments, **more)  # pyright: ignore[reportArgumentType] - handed on

    monkeypatch.setattr(batch_jobs, "advance", after_its_end)
    with pytest.raises(DocumentError, match="this one is Completed"):
        cancel_job(running.store, f"{running.id}/4")
    assert describe_job(running.store, f"{running.id}/4").status == "Completed"


def test_a_job_that_is_being_stopped_is_terminating_and_one_that_never_began_is_canceled(running: OpenBatch):
    for index in (4, 11):
        cancel_job(running.store, f"{running.id}/{index}")
    states = [str(describe_job(running.store, f"{running.id}/{index}").status) for index in (3, 4, 5, 10, 11)]
    assert states == ["Failed", "Terminating", "Running", "Pending", "Canceled"]
    cancel_batch(running.store, running.id)
    states = [str(describe_job(running.store, f"{running.id}/{index}").status) for index in (3, 4, 5, 10, 11)]
    assert states == ["Failed", "Terminating", "Terminating", "Pending", "Canceled"]


def test_a_job_that_was_canceled_before_it_began_stays_canceled_when_its_lanes_begin(running: OpenBatch):
    cancel_job(running.store, f"{running.id}/11")
    begin_chunk(running.store, running.id, running.layout.chunk_of(11), 0.0)
    cancel_job(running.store, f"{running.id}/11")
    states = [str(describe_job(running.store, f"{running.id}/{index}").status) for index in (10, 11)]
    assert states == ["Running", "Canceled"]


def test_it_is_restarting_until_it_ends_and_says_when_it_began_anew(file_store: Store):
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    first = describe_job(file_store, f"{batch.id}/1")
    restart_job(file_store, f"{batch.id}/1")
    again = describe_job(file_store, f"{batch.id}/1")
    assert (first.status, again.status) == ("Running", "Restarting")
    assert again.lastStartedAt is not None
    assert first.lastStartedAt is not None
    assert again.lastStartedAt > first.lastStartedAt
    assert describe_job(file_store, f"{batch.id}/2").status == "Running"


def test_a_restart_changes_no_row_and_is_over_with_the_chunk(file_store: Store):
    batch, parts = begun(file_store), list[list[int]]()

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        parts.append([request.index for request in part.chunk.requests])
        restart_job(file_store, f"{batch.id}/1")
        return all_pass(part)

    run_chunk(batch, 0, simulate, lanes=4, left_s=3600.0)
    assert parts == [[0, 1, 2, 3]]
    assert committed_chunk(file_store, batch.id, 0) == [passed(index) for index in range(4)]
    assert describe_job(file_store, f"{batch.id}/1").status == "Completed"


@pytest.mark.parametrize(("index", "status"), [(0, "Completed"), (2, "Terminating"), (4, "Canceled"), (5, "Pending")])
def test_only_a_running_job_is_restarted(file_store: Store, index: int, status: str):
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    for job in (2, 4):
        cancel_job(file_store, f"{batch.id}/{job}")
    if status == "Completed":
        run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
    with pytest.raises(DocumentError, match=f"a job that is running; this one is {status}"):
        restart_job(file_store, f"{batch.id}/{index}")


def test_nothing_is_restarted_in_a_batch_that_is_being_stopped(file_store: Store):
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    cancel_batch(file_store, batch.id)
    with pytest.raises(DocumentError, match="this one is Terminating"):
        restart_job(file_store, f"{batch.id}/0")


def test_the_command_restarts_a_job_and_nothing_else(file_store: Store):
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    job = batch.record().arn.replace("simulation-job-batch", "simulation-job")
    restart_named_job(file_store, f"{job}/1")
    assert describe_job(file_store, f"{batch.id}/1").status == "Restarting"
    with pytest.raises(DocumentError, match="a simulation-job, such as"):
        restart_named_job(file_store, batch.record().arn)
    with pytest.raises(ResourceNotFound):
        restart_named_job(file_store, f"{job}/6")
