"""Ten million episodes on a thousand workers, simulated: what it costs beside the episodes, and what breaks first.

    .venv/bin/python -m benchmarks.scale.scale_plan [--document docs/operate/scale.md]

The costs are measured on this machine (``benchmarks.scale.scale_costs``), the cluster is simulated, event by event:
workers that take pieces of chunks as ``flows.prefect.worker_cluster`` hands them out and paces them, some of which are
reclaimed by their cloud; the flow's process and Prefect's server, each of which does one thing at a time; and the one
process that writes the tables at the end. What S3 bears is what AWS documents for a prefix: 3,500 requests a second
that write, and 5,500 that read.
"""

import heapq
import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.harness import machine, markdown, options, show
from benchmarks.scale.scale_costs import Costs, costs
from flows.prefect.worker_cluster import PieceSize

EPISODES = 10_000_000
_LANES = 256
_AHEAD = 2
# Of seconds that a chunk takes: a fast engine's short deliveries, and a slow engine's, or long ones.
_CHUNKS_S = (4.0, 60.0)
_WORKERS = (10, 100, 1_000, 10_000)
# Of workers that a cloud may take back, one in twenty every hour; a new one starts, imports and loads for 40 s.
_RECLAIMED_AN_HOUR = 0.05
_RESTART_S = 40.0
_SPREAD = 0.25
_SEED = 20261121
_S3_WRITES_A_SECOND, _S3_READS_A_SECOND = 3_500.0, 5_500.0


class Cluster(NamedTuple):
    """What is simulated.

    Attributes:
        workers: How many.
        chunks: Of the batch.
        chunk_s: Mean seconds of a worker for a chunk.
    """

    workers: int
    chunks: int
    chunk_s: float


class Outcome(NamedTuple):
    """What came of it.

    Attributes:
        episodes_s: Until the last chunk was committed.
        tables_s: From then to the end.
        busy: Share of the workers' seconds in which they simulated what was committed.
        task_runs: Prefect's.
        lost: Pieces that were handed out again.
        driver: Share of a core that the flow's process used.
        server: Share of a core that Prefect's server would have used; above 1 it falls behind.
        writes: Requests to the store that write, in all.
        reads: Likewise, that read.
    """

    episodes_s: float
    tables_s: float
    busy: float
    task_runs: int
    lost: int
    driver: float
    server: float
    writes: float
    reads: float


class _Driver:
    """The flow's process, which hands out a piece, or hears of one, at a time."""

    def __init__(self, each_s: float) -> None:
        self.free_s, self.busy_s, self._each_s = 0.0, 0.0, each_s / 2

    def at(self, time_s: float) -> float:
        """Returns when it has done something that came up at a time."""
        self.free_s = max(self.free_s, time_s) + self._each_s
        self.busy_s += self._each_s
        return self.free_s


class _Piece(NamedTuple):
    done_s: float
    size: int
    took_s: float
    dead: bool


def simulate(cluster: Cluster, cost: Costs, rng: np.random.Generator) -> Outcome:
    """Returns what comes of a batch on a cluster.

    Args:
        cluster: How many workers, and what they have to do.
        cost: What is beside the episodes.
        rng: Of pieces' durations and of workers that are reclaimed.
    """
    pace, driver = PieceSize(), _Driver(cost.driver_s)
    left, task_runs, lost, useful_s, now_s, end_s = cluster.chunks, 0, 0, 0.0, 0.0, 0.0
    flying: list[_Piece] = []  # the next to end first
    free = [(0.0, number) for number in range(cluster.workers)]  # when each worker has done what it was given
    while left or flying:
        while left and len(flying) < cluster.workers * _AHEAD:
            size = pace.size(left, cluster.workers)
            left, task_runs = left - size, task_runs + 1
            free_s, worker = heapq.heappop(free)
            took_s = size * cluster.chunk_s * rng.lognormal(-(_SPREAD**2) / 2, _SPREAD)
            dies_s = rng.exponential(3600.0 / _RECLAIMED_AN_HOUR)
            begin_s, dead = max(free_s, driver.at(now_s)), dies_s < took_s + cost.worker_s
            done_s = begin_s + (dies_s if dead else took_s + cost.worker_s)
            heapq.heappush(free, (done_s + (_RESTART_S if dead else 0.0), worker))
            heapq.heappush(flying, _Piece(done_s, size, took_s, dead))
        piece = heapq.heappop(flying)
        now_s = driver.at(piece.done_s)
        if piece.dead:
            left, lost = left + piece.size, lost + 1
        else:
            pace.learn(piece.size, piece.took_s)
            useful_s, end_s = useful_s + piece.took_s, now_s
    return Outcome(
        episodes_s=end_s,
        tables_s=cluster.chunks * _LANES / cost.rows_per_s,
        busy=useful_s / (cluster.workers * end_s),
        task_runs=task_runs,
        lost=lost,
        driver=driver.busy_s / end_s,
        server=task_runs * cost.server_s / end_s,
        writes=cluster.chunks * cost.writes,
        reads=cluster.chunks * cost.reads,
    )


def first_to_break(outcome: Outcome) -> str:
    """Returns what is nearest to what it can do, or beyond, in words."""
    loads = {
        "Prefect's server": outcome.server,
        "the flow's process": outcome.driver,
        "S3, writing to one prefix": outcome.writes / outcome.episodes_s / _S3_WRITES_A_SECOND,
        "S3, reading from one prefix": outcome.reads / outcome.episodes_s / _S3_READS_A_SECOND,
        "writing the tables": outcome.tables_s / outcome.episodes_s,
    }
    name = max(loads, key=lambda each: loads[each])
    return f"{name}: {100 * loads[name]:.0f} %"


def plan_table(cost: Costs) -> str:
    """Returns the table of ten million episodes on more and more workers."""
    rng = np.random.default_rng(_SEED)
    head = ["chunk, s", "workers", "episodes, h", "tables, min", "busy, %", "task runs", "lost", "requests/s"]
    rows = [[*head, "flow's core, %", "server's core, %", "nearest to its limit"]]
    for chunk_s in _CHUNKS_S:
        for workers in _WORKERS:
            made = simulate(Cluster(workers, -(-EPISODES // _LANES), chunk_s), cost, rng)
            rows.append(_row(chunk_s, workers, made))
    return markdown(rows)


def _row(chunk_s: float, workers: int, made: Outcome) -> list[str]:
    return [
        f"{chunk_s:.0f}",
        f"{workers:,}",
        f"{made.episodes_s / 3600:.2f}",
        f"{made.tables_s / 60:.0f}",
        f"{100 * made.busy:.0f}",
        f"{made.task_runs:,}",
        f"{made.lost}",
        f"{(made.writes + made.reads) / made.episodes_s:.0f}",
        f"{100 * made.driver:.0f}",
        f"{100 * made.server:.0f}",
        first_to_break(made),
    ]


def cost_table(cost: Costs) -> str:
    """Returns the table of what was measured."""
    facts: Sequence[tuple[str, str]] = (
        ("requests to the store for a chunk: writing, reading", f"{cost.writes:.1f}, {cost.reads:.1f}"),
        ("a chunk of 256 episodes, KB", f"{cost.chunk_bytes / 1000:.0f}"),
        ("the batch's record, KB, whatever its episodes", f"{cost.record_bytes / 1000:.0f}"),
        ("rows of results that a process writes, a second", f"{cost.rows_per_s:,.0f}"),
        ("of the tables, bytes for an episode", f"{cost.row_bytes:.0f}"),
        ("a piece: CPU of the flow's process, ms", f"{1000 * cost.driver_s:.0f}"),
        ("a piece: around the work of its worker, ms", f"{1000 * cost.worker_s:.0f}"),
        ("a piece: CPU of Prefect's server, ms", f"{1000 * cost.server_s:.0f}"),
    )
    return markdown([["what", "measured"], *([what, figure] for what, figure in facts)])


def main() -> None:
    """Prints the tables, or writes them into a document."""
    given = options(__doc__).parse_args()
    from flows.prefect.prefect_server import prefect_home  # noqa: PLC0415 - so that a test of the simulation needs no server
    from tasks.server.process import run_server, wait_until_healthy  # noqa: PLC0415 - as above

    with run_server(prefect_home()) as (server, child):
        os.environ.update(server.environment())
        wait_until_healthy(server, child)
        measured = costs(child.pid)
    tables = f"{machine()}\n\n{cost_table(measured)}\n\n{EPISODES:,} episodes:\n\n{plan_table(measured)}"
    show("scale plan", tables, given.document)


if __name__ == "__main__":
    main()
