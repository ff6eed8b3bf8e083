"""`simyard` as a process, and what it leaves in a store."""

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from tasks.simulate.devices import compilation_cache
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, records
from tests.repository import ROOT

JOB_KINDS = ("world-generation-job", "world-export-job", "simulation-job-batch", "deployment-job", "pipeline-run")


def small_document(**changes: object) -> dict[str, object]:
    """Returns the quickstart with fewer worlds, seeds and robots, two chunks, all recorded, sections as changed."""
    document = yaml.safe_load((ROOT / "examples/quickstart.yaml").read_text())
    document["worldGeneration"]["worldCount"] = {"floorplanCount": 2, "interiorCountPerFloorplan": 1}
    document["simulationBatch"]["batchPolicy"]["maxConcurrency"] = 16
    document["simulationBatch"]["matrix"]["seeds"] = 8
    document["simulationBatch"]["recordings"] = {"episodes": "all", "rateHz": 4}
    document["gate"] = {"successRate": {"atLeast": 0.5}}
    document["deployment"]["fleet"]["localAgents"] = 2
    return {**document, **changes}


def write_document(folder: Path, document: Mapping[str, object]) -> Path:
    """Returns the document's file, with its template beside it."""
    (folder / "templates").mkdir(parents=True, exist_ok=True)
    template = (ROOT / "examples/templates/two-rooms.json").read_bytes()
    (folder / "templates/two-rooms.json").write_bytes(template)
    file = folder / "document.yaml"
    file.write_text(json.dumps(document, indent=1))  # JSON is YAML, and never has aliases
    return file


def own_cache(folder: Path) -> str:
    """Returns a new cache folder but for its compiled programs, which are this machine's: none is compiled twice.

    They lie by the digests of the applications that they are made of, and are no part of what a cache says.
    """
    folder.mkdir(parents=True, exist_ok=True)
    programs = compilation_cache()
    programs.mkdir(parents=True, exist_ok=True)
    if not (folder / "programs").exists():
        (folder / "programs").symlink_to(programs)
    return str(folder)


def simyard(*arguments: str, **environment: str) -> subprocess.Popen[str]:
    """Returns the command, started."""
    return subprocess.Popen(
        [str(Path(sys.executable).with_name("simyard")), *arguments],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Returns the command, ended."""
    process = simyard(*arguments, **environment)
    out, err = process.communicate()
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


def kill_when(process: subprocess.Popen[str], reached: Callable[[], bool]) -> None:
    """Kills the process with SIGKILL as soon as something is reached.

    Raises:
        AssertionError: It ended before.
    """
    while not reached():
        assert process.poll() is None, f"ended before it was killed: {process.communicate()}"
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL


def jobs(store: Store) -> dict[str, list[JobRecord]]:
    """Returns all job records by kind."""
    return {kind: records(store, kind) for kind in JOB_KINDS}  # pyright: ignore[reportArgumentType]


def tables(store: Store) -> dict[str, pa.Table]:
    """Returns the result tables of the store's only batch, read back from where its record says they are."""
    (batch,) = records(store, "simulation-job-batch")
    found: dict[str, pa.Table] = {}
    for name in ("results", "failures"):
        key = str(batch.detail[f"{name}_url"]).removeprefix(store.url + "/")
        found[name] = pq.read_table(pa.BufferReader(store.get(key).body))
    return found


def recordings(store: Store) -> dict[str, bytes]:
    """Returns the recordings of the store's only batch, by file name."""
    (batch,) = records(store, "simulation-job-batch")
    folder = str(batch.detail["recordings_url"]).removeprefix(store.url + "/")
    return {key.removeprefix(folder): store.get(key).body for key in store.keys(folder)}


def audit(store: Store) -> bytes:
    """Returns the audit of the store's only batch, as it lies beside its tables."""
    (batch,) = records(store, "simulation-job-batch")
    return store.get(str(batch.detail["audit_url"]).removeprefix(store.url + "/")).body


def assert_same(ours: Store, theirs: Store) -> None:
    """Compares what two runs of one document have left, job by job and byte by byte; each episode is there once."""
    assert [[job.id for job in found] for found in jobs(ours).values()] == [
        [job.id for job in found] for found in jobs(theirs).values()
    ]
    assert {*Counter(tables(ours)["results"].column("index").to_pylist()).values()} == {1}
    assert (worlds(ours), recordings(ours), audit(ours)) == (worlds(theirs), recordings(theirs), audit(theirs))
    assert all(tables(ours)[name].equals(table) for name, table in tables(theirs).items())


def worlds(store: Store) -> dict[str, bytes]:
    """Returns all worlds of the store."""
    return {key: store.get(key).body for key in store.keys("worlds")}
