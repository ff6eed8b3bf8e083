"""RestartSimulationJob: a running job runs once more and ends as it would have (docs/decisions/0008)."""

import pytest

from flows.resources.kinds import restart_named_job
from specs.data.episode import EpisodeResult
from specs.errors import DocumentError, ResourceNotFound
from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job, describe_job, restart_job
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import begin_chunk, chunk_start, committed_chunk
from tasks.storage.base.store import Store
from tests.factories.episodes import passed
from tests.factories.planned_batches import all_pass, begun, stops_after


class Restarted:
    """Simulates, and restarts jobs while it does: those listed for the first part, then those for the second."""

    def __init__(self, batch: OpenBatch, *jobs: tuple[int, ...]) -> None:
        self.batch, self.jobs = batch, list(jobs)
        self.parts: list[list[int]] = []

    def __call__(self, part: ChunkPart) -> list[EpisodeResult]:
        self.parts.append([request.index for request in part.chunk.requests])
        for index in self.jobs.pop(0) if self.jobs else ():
            restart_job(self.batch.store, f"{self.batch.id}/{index}")
        return all_pass(part)


def test_a_restarted_job_runs_once_more_and_the_others_do_not(file_store: Store):
    batch = begun(file_store)
    simulate = Restarted(batch, (1, 2), (2,))
    run_chunk(batch, 0, simulate, lanes=4, left_s=9.0)
    assert simulate.parts == [[0, 1, 2, 3], [1, 2], [2]]
    assert committed_chunk(file_store, batch.id, 0) == [passed(index) for index in range(4)]


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


def test_a_restart_that_a_dead_process_did_not_see_is_done_by_beginning_the_chunk_again(file_store: Store):
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    restart_job(file_store, f"{batch.id}/1")
    simulate = Restarted(batch)
    run_chunk(batch, 0, simulate, lanes=4, left_s=9.0)
    assert simulate.parts == [[0, 1, 2, 3]]
    start = chunk_start(file_store, batch.id, 0)
    assert start
    assert describe_job(file_store, f"{batch.id}/1").lastStartedAt == start.started_at_s


def test_what_is_stopped_while_it_runs_again_keeps_the_row_that_it_had(file_store: Store):
    batch = begun(file_store)

    class Canceled(Restarted):
        def __call__(self, part: ChunkPart) -> list[EpisodeResult]:
            if self.parts:
                cancel_batch(file_store, batch.id)
                part.watch._next_look_s = 0.0  # as if a second had passed
                return [*stops_after(0)(part)]
            return super().__call__(part)

    run_chunk(batch, 0, Canceled(batch, (1,)), lanes=4, left_s=9.0)
    assert committed_chunk(file_store, batch.id, 0) == [passed(index) for index in range(4)]


@pytest.mark.parametrize(("index", "status"), [(0, "Completed"), (2, "Terminating"), (4, "Canceled"), (5, "Pending")])
def test_only_a_running_job_is_restarted(file_store: Store, index: int, status: str):
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    for job in (2, 4):
        cancel_job(file_store, f"{batch.id}/{job}")
    if status == "Completed":
        run_chunk(batch, 0, all_pass, lanes=4, left_s=9.0)
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
