"""How much memory a generation job takes, by its number of worlds.

    .venv/bin/python benchmarks/worlds/world_memory.py WORLDS

makes one job in this process and prints its figures as JSON; `measure_memory` runs that in a fresh process.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest, WorldCount
from specs.settings import MAX_WORLDS

_TEMPLATE = "two-rooms"
_INTERIORS = 10
_WORKERS = 2
_ARN = "arn:simyard:world-template:benchmark:two-rooms"


@dataclass(frozen=True)
class JobFigures:
    """What one job took.

    Attributes:
        seconds: From submission to the terminal record, start of the workers and writing included.
        job_mb: Most memory that the job's own process held.
        worker_mb: Most memory that one of its workers held.
        stored_mb: Size of the worlds in the store.
    """

    worlds: int
    seconds: float
    job_mb: float
    worker_mb: float
    stored_mb: float


def measure_memory(worlds: int) -> JobFigures:
    """Returns the figures of a job of so many worlds, in a fresh process and a store in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as folder:
        done = subprocess.run(
            [sys.executable, __file__, str(worlds)],
            cwd=folder,
            env={**os.environ, MAX_WORLDS.variable: str(worlds)},
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
    return JobFigures(**json.loads(done.stdout))


def run_job(worlds: int) -> JobFigures:
    """Returns the figures of a job that this process runs, on a store in the working directory."""
    # Imported here so that the parent, whose size a child inherits in the kernel's books, stays small.
    from benchmarks.worlds.world_templates import read_template  # noqa: PLC0415
    from tasks.storage.store_url import open_store  # noqa: PLC0415
    from tasks.worlds.job.generation_job import run_generation_job  # noqa: PLC0415

    folder = Path.cwd() / "store"
    count = WorldCount(floorplanCount=worlds // _INTERIORS, interiorCountPerFloorplan=_INTERIORS)
    start_s = time.perf_counter()
    record = run_generation_job(
        open_store(folder.as_uri()),
        CreateWorldGenerationJobRequest(template=_ARN, worldCount=count),
        read_template(_TEMPLATE),
        seed=0,
        token="benchmark",  # noqa: S106 - a client request token is no secret
        progress=lambda *_: None,
        workers=_WORKERS,
    )
    seconds = time.perf_counter() - start_s
    if record.status != "Completed":
        raise SystemExit(f"the job ended {record.status}: {record.failure_reason}")
    stored = sum(path.stat().st_size for path in (folder / "worlds").rglob("*") if path.is_file())
    worker_kb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return JobFigures(worlds, seconds, _peak_kb() / 1e3, worker_kb / 1e3, stored / 1e6)


def _peak_kb() -> int:
    """Returns the most memory that this program held; getrusage would count what it was before exec, too."""
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:"))


if __name__ == "__main__":
    print(json.dumps(asdict(run_job(int(sys.argv[1])))))
