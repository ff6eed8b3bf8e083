"""Rows of tables that a process writes in a second, alone: of some 100,000 episodes whose numbers all differ.

    .venv/bin/python -m benchmarks.scale.scale_tables [--store FOLDER] [--runs 4] [--status Completed] [--document FILE]

A few chunks are simulated, and all others made of them, each measure moved a little: half a minute, once for a store,
so that another version of the code can be measured with the same one (``PYTHONPATH``). A process's first run imports
what it needs. The digests tell whether two versions write the same bytes.
"""

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.harness import machine, markdown, options, show
from benchmarks.scale.scale import Case, section
from benchmarks.scale.scale_costs import opened_batch, simulate_some
from flows.batch.batch_steps import write_tables
from specs.data.episode_columns import Cells, EpisodeColumns
from specs.pipeline.simulation_section import SimulationBatch
from tasks.simulate.batch.batch_record import OpenBatch, load_batch
from tasks.simulate.batch.chunk_store import commit, counted_columns
from tasks.simulate.plan.plan_batch import output_location
from tasks.storage.store_url import open_store

CASE = Case(100_000)
_SIMULATED, _MOVED_BY, _SEED = 6, 0.05, 20261126
_MEASURES = (
    "path_length_m",
    "shortest_path_m",
    "min_clearance_m",
    "energy_j",
    "final_x_m",
    "final_y_m",
    "final_yaw_rad",
    "trajectory",
)


def prepare(folder: Path) -> OpenBatch:
    """Returns a batch all of whose chunks are committed; it is made if the folder holds none."""
    name = folder / "batch"
    if name.exists():
        return load_batch(open_store((folder / "store").as_uri()), name.read_text())
    batch, rng = opened_batch(folder, CASE), np.random.default_rng(_SEED)
    simulate_some(batch, tuple(range(_SIMULATED)))
    simulated = [counted_columns(batch.store, batch.id, number, batch.authenticator) for number in range(_SIMULATED)]
    for number in range(_SIMULATED, batch.layout.chunks):
        index = np.array([request.index for request in batch.layout.chunk(number).requests])
        rows = cast("EpisodeColumns", simulated[number % _SIMULATED]).take(np.arange(len(index)))
        moved = {name: _moved(rows.cells[name], rng) for name in _MEASURES}
        cells: Mapping[str, Cells] = {**rows.renumbered(index).cells, **moved}
        commit(batch.store, batch.id, number, EpisodeColumns(cells, len(index)), batch.authenticator)
    name.write_text(batch.id)
    return batch


def _moved(cells: Cells, rng: np.random.Generator) -> Cells:
    """Returns a column with other numbers, 32 bits of them, as engines measure."""
    numbers = cast("np.ndarray", cells.numbers)
    return cells._replace(
        numbers=(numbers + rng.normal(0.0, _MOVED_BY, numbers.shape)).astype(np.float32).astype(float)
    )


def measure(batch: OpenBatch, status: str) -> list[object]:
    """Returns a run's rows a second, microseconds of the processor for a row, and what its files begin with."""
    location = output_location(SimulationBatch.model_validate(section(CASE)))
    at, cpu = time.perf_counter(), time.process_time()
    tables = write_tables(batch.store.url, batch.id, status, location)
    took_s, cpu_s = time.perf_counter() - at, time.process_time() - cpu
    rows, digests = batch.layout.episodes, cast("Mapping[str, str]", tables.detail["sha256s"])
    return [f"{rows / took_s:,.0f}", f"{1e6 * cpu_s / rows:.2f}", *(digest[:12] for digest in digests.values())]


def main() -> None:
    """Prints what each run took, or writes it into a document."""
    parser = options(__doc__)
    parser.add_argument("--store", type=Path, help="a folder; what is made there is used again")
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--status", default="Completed", help="that the batch ends in")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="simyard-tables-") as folder:
        batch = prepare((given.store or Path(folder)).resolve())
        rows = [["run", "rows a second", "processor, us a row", "results", "failures"]]
        rows += [[str(number), *map(str, measure(batch, given.status))] for number in range(given.runs)]
    show("scale tables", f"{machine()}\n\n{markdown(rows)}", given.document)


if __name__ == "__main__":
    main()
