"""Worlds that a cluster's workers make and write: those of one process, to the byte, also when workers are killed."""

import os
import signal
import time
from pathlib import Path

import pytest

from flows.prefect.spread_work import WORTH_MAKING
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.integration.runs import jobs, simyard, small_document, worlds, write_document
from tests.integration.spread.test_spread_batches import workers_of
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.soak, pytest.mark.timeout(280)]


def document(folder: Path) -> str:
    spec = {name: section for name, section in small_document().items() if name in {"name", "worldGeneration"}}
    spec["worldGeneration"]["worldCount"] = {"floorplanCount": WORTH_MAKING // 4, "interiorCountPerFloorplan": 4}  # pyright: ignore[reportIndexIssue]
    export = {"outputLocation": {"s3Bucket": "worlds", "s3Prefix": "all"}, "formats": ["svg", "map"]}
    return str(write_document(folder, {**spec, "worldExport": export}))


def run(folder: Path, workers: str, *, killing: bool = False) -> Store:
    """Returns the store that a run left; in the middle of making worlds, and of writing them, workers are killed."""
    folder.mkdir()
    root = folder / "store"
    process = simyard(
        "run",
        document(folder),
        "--store",
        root.as_uri(),
        SIMYARD_WORKERS=workers,
        SIMYARD_MAX_WORLDS="1000",
        SIMYARD_BUCKETS=(folder / "buckets").as_uri(),
    )
    for begun in ("worlds/*/world-*.json", "parts/*/*/*.zip") if killing else ():
        assert eventually(lambda begun=begun: len([*root.glob(begun)]) > 3, timeout_s=120.0)
        for worker in workers_of(process.pid):
            os.kill(worker, signal.SIGKILL)
        time.sleep(1)
    out, err = process.communicate(timeout=250)
    assert process.returncode == 0, out + err
    return open_store(root.as_uri())


def zipped(store: Store) -> object:
    (job,) = jobs(store)["world-export-job"]
    return job.detail["sha256"]


def test_dask_workers_that_are_killed_make_and_write_the_worlds_of_one_process(tmp_path: Path) -> None:
    alone, killed = run(tmp_path / "alone", ""), run(tmp_path / "killed", "dask:2", killing=True)
    assert len(worlds(alone)) == WORTH_MAKING + 1  # and their contact sheet
    assert worlds(killed) == worlds(alone)
    assert zipped(killed) == zipped(alone)
    assert killed.keys("parts") == []
