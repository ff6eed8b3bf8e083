"""Queued jobs at a work pool: a real server, a process worker, two that hand over, and a flow run that is lost."""

import os
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterTags
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

from flows.queue.pool import PoolDesk
from specs.errors import DocumentError
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import queued_jobs
from tasks.storage.jobs.records import JobRecord, read
from tests.flows.queue.queued_jobs import queue_generation
from tests.repository import ROOT
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.usefixtures("prefect_server")]
POOL = "api-pool"


@pytest.fixture(scope="module", autouse=True)
def pool(prefect_server: str) -> Generator[None]:
    """Makes the pool, at the server that this process asks, too."""
    _prefect("work-pool", "create", POOL, "--type", "process", "--overwrite")
    password = os.environ["PREFECT_API_AUTH_STRING"]
    with temporary_settings({PREFECT_API_URL: prefect_server, PREFECT_API_AUTH_STRING: password}):
        yield


@pytest.fixture
def worker(tmp_path: Path) -> Generator[None]:
    """Runs a worker of the pool."""
    with (tmp_path / "worker.log").open("wb") as log:
        process = subprocess.Popen(
            [_program("prefect"), "worker", "start", "--pool", POOL], cwd=ROOT, stdout=log, stderr=log
        )
        yield
        process.terminate()
        process.wait()


def _program(name: str) -> str:
    return str(Path(sys.executable).with_name(name))


def _prefect(*arguments: str) -> None:
    subprocess.run([_program("prefect"), *arguments], check=True, capture_output=True)


def _flow_runs(job: JobRecord) -> list[str]:
    with get_client(sync_client=True) as client:
        found = client.read_flow_runs(flow_run_filter=FlowRunFilter(tags=FlowRunFilterTags(all_=[job.id])))
    return [str(each.id) for each in found]


def _look(desk: PoolDesk, store: Store) -> None:
    for entry in queued_jobs(store):
        desk.look(entry)


def test_two_gateways_hand_a_job_over_once_and_a_lost_flow_run_again(file_store: Store):
    job, desks = queue_generation(file_store, "twice"), [PoolDesk(file_store, POOL), PoolDesk(file_store, POOL)]
    (entry,) = queued_jobs(file_store)

    for desk in desks:  # both have seen it before either handed it over
        desk.look(entry)
        desk.look(entry)

    (flow_run,) = _flow_runs(job)
    with get_client(sync_client=True) as client:
        client.delete_flow_run(flow_run)  # pyright: ignore[reportArgumentType]
    for desk in desks:
        _look(desk, file_store)
    (again,) = _flow_runs(job)
    assert again != flow_run


@pytest.mark.usefixtures("worker")
def test_a_process_worker_ends_a_job_that_was_handed_over(file_store: Store):
    job, desk = queue_generation(file_store, "pooled"), PoolDesk(file_store, POOL)
    _look(desk, file_store)

    def is_done() -> bool:
        return read(file_store, job.kind, job.id).status == "Completed" and not queued_jobs(file_store)

    assert eventually(is_done)


def test_a_pool_that_there_is_not_is_refused_with_the_command_that_makes_it(file_store: Store):
    with pytest.raises(DocumentError, match="prefect work-pool create nowhere --type process"):
        PoolDesk(file_store, "nowhere")
