"""A batch on the workers of a cluster, one of which is killed: the tables are those of one process, to the byte."""

import importlib.util
import os
import signal
from pathlib import Path

import pytest

from tasks.simulate.batch.chunk_store import chunk_start
from tasks.storage.store_url import open_store
from tests.integration.runs import (
    audit,
    finished,
    jobs,
    recordings,
    simyard,
    small_document,
    tables,
    worlds,
    write_document,
)
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]
ray_installed = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="simyard[ray] is not installed")


def same(ours: Path, theirs: Path) -> bool:
    one, two = open_store(ours.as_uri()), open_store(theirs.as_uri())
    assert worlds(one) == worlds(two)
    assert recordings(one) == recordings(two)
    assert audit(one) == audit(two)
    return all(tables(one)[name].equals(table) for name, table in tables(two).items())


def workers_of(pid: int) -> list[int]:
    """Returns the Dask workers below a process: what multiprocessing spawned, as Dask's nannies do."""
    return [
        child for child in descendants(pid) if b"multiprocessing.spawn" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]


def descendants(pid: int) -> list[int]:
    children = [
        int(child) for each in Path(f"/proc/{pid}/task").glob("*/children") for child in each.read_text().split()
    ]
    return [*children, *(grandchild for child in children for grandchild in descendants(child))]


@pytest.mark.soak
def test_dask_workers_of_which_one_is_killed_write_the_tables_of_one_process(tmp_path: Path, small_run: Path) -> None:
    store = tmp_path / "store"
    process = simyard(
        "run", str(write_document(tmp_path, small_document())), "--store", store.as_uri(), SIMYARD_WORKERS="dask:2"
    )
    assert eventually(lambda: any(store.glob("chunks/*/*.started.json")), timeout_s=120.0)
    for worker in workers_of(process.pid):
        os.kill(worker, signal.SIGKILL)
    out, err = process.communicate(timeout=200)
    assert process.returncode == 0, out + err
    assert same(store, small_run / ".simyard")
    (batch,) = jobs(open_store(store.as_uri()))["simulation-job-batch"]
    assert batch.status == "Completed"
    starts = [chunk_start(open_store(store.as_uri()), batch.id, number) for number in range(2)]
    assert max(start.attempts for start in starts if start) > 1  # somebody died of it


@pytest.mark.soak
@ray_installed
def test_ray_workers_write_the_tables_of_one_process(tmp_path: Path, small_run: Path) -> None:
    store = tmp_path / "store"
    result = finished(
        "run", str(write_document(tmp_path, small_document())), "--store", store.as_uri(), SIMYARD_WORKERS="ray:2"
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert same(store, small_run / ".simyard")


@pytest.mark.long
def test_workers_that_there_are_not_are_told_before_anything_runs(tmp_path: Path) -> None:
    store = tmp_path / "store"
    result = finished(
        "run", str(write_document(tmp_path, small_document())), "--store", store.as_uri(), SIMYARD_WORKERS="spark"
    )
    assert result.returncode == 2
    assert "SIMYARD_WORKERS" in result.stderr
    assert not any(store.glob("jobs/simulation-job-batch/*"))
