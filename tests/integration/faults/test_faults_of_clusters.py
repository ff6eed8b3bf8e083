"""Dask clusters whose workers are killed again and again: nothing is lost, and nothing is done twice."""

import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from tasks.simulate.batch.chunk_store import chunk_numbers
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.integration.runs import audit, jobs, recordings, simyard, small_document, tables, worlds, write_document
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.soak, pytest.mark.timeout(550)]
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


def same(ours: Store, theirs: Store) -> bool:
    """Returns whether two stores have the same results, each episode once."""
    assert {kind: len(found) for kind, found in jobs(ours).items()} == {
        kind: len(found) for kind, found in jobs(theirs).items()
    }
    indices = Counter(tables(ours)["results"].column("index").to_pylist())
    assert set(indices.values()) == {1}
    assert (worlds(ours), recordings(ours), audit(ours)) == (worlds(theirs), recordings(theirs), audit(theirs))
    return all(tables(ours)[name].equals(table) for name, table in tables(theirs).items())


@pytest.fixture(params=["folder", "bucket"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "folder":
        return (tmp_path / "store").as_uri()
    make: Callable[[], str] = request.getfixturevalue("s3_url")
    return make()


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
        out, err = run.communicate(timeout=400)
    assert run.returncode == 0, out + err
    assert same(open_store(url), open_store((small_run / ".simyard").as_uri()))


def _in_simulation(run: "subprocess.Popen[str]", url: str) -> None:
    def begun() -> bool:
        store = open_store(url)
        found = jobs(store)["simulation-job-batch"]
        return run.poll() is not None or bool(found and chunk_numbers(store, found[0].id).begun)

    eventually(begun, timeout_s=200.0)
    assert run.poll() is None, run.communicate()
