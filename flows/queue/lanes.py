"""The lanes of a worker: which jobs wait for each other, and which never do."""

from collections.abc import Mapping
from typing import NamedTuple

from specs.job_kinds import JobKind

_PREFECT = ("flows.queue.queued_flows", "prefect.flow_engine", "prefect.task_engine", "prefect.utilities.visualization")


class Lane(NamedTuple):
    """What a lane works on.

    Attributes:
        kinds: Of its jobs.
        at_once: How many jobs it works on at once; 1 where a job wants the machine.
        modules: What is imported before the first job comes.
        per_worker: Whether each worker has one; otherwise one does for all.
    """

    kinds: tuple[JobKind, ...]
    at_once: int
    modules: tuple[str, ...]
    per_worker: bool


# A roll-out waits for robots most of the time, and a batch may take hours: neither has to wait for the other, nor
# worlds for a batch. They share the cores as processes do.
LANES: Mapping[str, Lane] = {
    "simulation": Lane(
        ("simulation-job-batch",), 1, ("tasks.simulate.chunk.episodes", "pyarrow.parquet", *_PREFECT), per_worker=True
    ),
    "worlds": Lane(("world-generation-job", "world-export-job"), 1, ("scipy.ndimage", *_PREFECT), per_worker=True),
    "fleets": Lane(("deployment-job",), 64, _PREFECT, per_worker=False),
}
