"""Batches and worlds on the workers of a cluster, which are killed: the bytes are those of one process."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from flows.prefect.spread_work import WORTH_MAKING
from tasks.simulate.batch.chunk_store import chunk_numbers, chunk_start
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.integration.runs import assert_same, finished, jobs, simyard, small_document, worlds, write_document
from tests.integration.searched_document import searched, searched_document
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration

ray_installed = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="simyard[ray] is not installed")


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
    assert eventually(lambda: any(store.glob("chunks/*/*.started.json")))
    for worker in workers_of(process.pid):
        os.kill(worker, signal.SIGKILL)
    out, err = process.communicate()
    assert process.returncode == 0, out + err
    assert_same(open_store(store.as_uri()), open_store((small_run / ".simyard").as_uri()))
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
    assert_same(open_store(store.as_uri()), open_store((small_run / ".simyard").as_uri()))


@pytest.mark.soak
@pytest.mark.timeout(1500)
def test_dask_workers_search_to_the_bytes_of_one_process(tmp_path: Path) -> None:
    document = str(searched_document(tmp_path / "document"))
    alone, spread = (open_store((tmp_path / name).as_uri()) for name in ("alone", "spread"))
    for store, how in ((alone, {"SIMYARD_WORKERS": ""}), (spread, {"SIMYARD_WORKERS": "dask:2"})):
        ended = finished("run", document, "--store", store.url, **how)
        assert ended.returncode == 0, ended.stdout + ended.stderr
    assert [key for key in alone.keys("searches/") if key in spread.keys("searches/")]
    assert searched(spread) == searched(alone)


@pytest.mark.long
def test_workers_that_there_are_not_are_told_before_anything_runs(tmp_path: Path) -> None:
    store = tmp_path / "store"
    result = finished(
        "run", str(write_document(tmp_path, small_document())), "--store", store.as_uri(), SIMYARD_WORKERS="spark"
    )
    assert result.returncode == 2
    assert "SIMYARD_WORKERS" in result.stderr
    assert not any(store.glob("jobs/simulation-job-batch/*"))


def worlds_document(folder: Path) -> str:
    spec = {name: section for name, section in small_document().items() if name in {"name", "worldGeneration"}}
    spec["worldGeneration"]["worldCount"] = {"floorplanCount": WORTH_MAKING // 4, "interiorCountPerFloorplan": 4}  # pyright: ignore[reportIndexIssue]
    export = {"outputLocation": {"s3Bucket": "worlds", "s3Prefix": "all"}, "formats": ["svg", "map"]}
    return str(write_document(folder, {**spec, "worldExport": export}))


def run_worlds(folder: Path, workers: str, *, killing: bool = False) -> Store:
    """Returns the store that a run left; in the middle of making worlds, and of writing them, workers are killed."""
    folder.mkdir()
    root = folder / "store"
    process = simyard(
        "run",
        worlds_document(folder),
        "--store",
        root.as_uri(),
        SIMYARD_WORKERS=workers,
        SIMYARD_MAX_WORLDS="1000",
        SIMYARD_BUCKETS=(folder / "buckets").as_uri(),
    )
    for begun in ("worlds/*/world-*.json", "parts/*/*/*.zip") if killing else ():
        assert eventually(lambda begun=begun: len([*root.glob(begun)]) > 3)
        for worker in workers_of(process.pid):
            os.kill(worker, signal.SIGKILL)
        time.sleep(1)
    out, err = process.communicate()
    assert process.returncode == 0, out + err
    return open_store(root.as_uri())


def zipped(store: Store) -> object:
    (job,) = jobs(store)["world-export-job"]
    return job.detail["sha256"]


@pytest.mark.soak
def test_dask_workers_that_are_killed_make_and_write_the_worlds_of_one_process(tmp_path: Path) -> None:
    alone, killed = run_worlds(tmp_path / "alone", ""), run_worlds(tmp_path / "killed", "dask:2", killing=True)
    assert len(worlds(alone)) == WORTH_MAKING + 1  # and their contact sheet
    assert worlds(killed) == worlds(alone)
    assert zipped(killed) == zipped(alone)
    assert killed.keys("parts") == []


_KILLS = 4


class Cluster:
    """A scheduler and two workers as processes; those that are killed are started again."""

    def __init__(self, port: int, folder: Path) -> None:
        self.address = f"tcp://127.0.0.1:{port}"
        self._folder = folder
        self.scheduler = self._start_scheduler()
        self.workers = [self._start_worker() for _ in range(2)]

    def kill_worker(self, which: int) -> None:
        self.workers[which].kill()
        self.workers[which].wait()
        self.workers[which] = self._start_worker()

    def end(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _start_scheduler(self) -> "subprocess.Popen[bytes]":
        port = self.address.rpartition(":")[2]
        return self._started("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")

    def _start_worker(self) -> "subprocess.Popen[bytes]":
        # Without a nanny, so that a kill ends the worker for good.
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self._folder))
        return self._started("worker", self.address, *options)

    def _started(self, *arguments: str) -> "subprocess.Popen[bytes]":
        dask = str(Path(sys.executable).with_name("dask"))
        with (self._folder / "dask.log").open("ab") as log:
            return subprocess.Popen([dask, *arguments], stdout=log, stderr=log)


@contextmanager
def cluster(folder: Path, port: int) -> Generator[Cluster]:
    folder.mkdir()
    with ExitStack() as stack:
        found = Cluster(port, folder)
        stack.callback(found.end)
        yield found


@pytest.fixture(params=["folder", "bucket"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "folder":
        return (tmp_path / "store").as_uri()
    make: Callable[[], str] = request.getfixturevalue("s3_url")
    return make()


@pytest.mark.soak
def test_workers_that_are_killed_at_random_moments_cost_only_time(url: str, tmp_path: Path, small_run: Path) -> None:
    rng = np.random.default_rng(0)
    with cluster(tmp_path / "dask", 18786) as dask:
        file = write_document(tmp_path, small_document())
        run = simyard("run", str(file), "--store", url, SIMYARD_WORKERS=dask.address)
        _in_simulation(run, url)
        for kill in range(_KILLS):
            time.sleep(rng.uniform(0.0, 6.0))
            if run.poll() is None:
                dask.kill_worker(kill % 2)
        out, err = run.communicate()
    assert run.returncode == 0, out + err
    assert_same(open_store(url), open_store((small_run / ".simyard").as_uri()))


def _in_simulation(run: "subprocess.Popen[str]", url: str) -> None:
    def begun() -> bool:
        store = open_store(url)
        found = jobs(store)["simulation-job-batch"]
        return run.poll() is not None or bool(found and chunk_numbers(store, found[0].id).begun)

    eventually(begun)
    assert run.poll() is None, run.communicate()
