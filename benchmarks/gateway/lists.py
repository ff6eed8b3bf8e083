"""How long a page of a list takes in stores of many jobs, as lists were and as they are (docs/decisions/0018).

    .venv/bin/python -m benchmarks.gateway.lists [--jobs 10000] [--s3-jobs 1000] [--document docs/operate/scale.md]

The folder has that many single jobs, a second one a batch of as many episodes; a real SeaweedFS has fewer. All jobs
have ended, one of fifty Failed. The stores are written as older versions of Simyard wrote them, so the first list of
each makes the lines. Each *cold* figure is that of a process of its own, from the call on; *warm* is the median of five
more calls there. A *before* is the same list by the records, in one more process.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path

from benchmarks.machine import machine
from benchmarks.tables import markdown, with_tables
from specs.robomaker.shared_operations import page_of
from specs.robomaker.simulation import ListSimulationJobBatchesRequest, ListSimulationJobsRequest
from tasks.simulate.batch.batch_jobs import Jobs
from tasks.simulate.batch.batch_record import KIND, close_batch, load_batch, open_batch
from tasks.simulate.batch.chunk_store import begin_chunk, commit
from tasks.simulate.batch.job_lists import list_batches_page, list_jobs_page
from tasks.storage.base.keys import chunk_key, chunk_start_key, job_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import JobRecord, job_id, read, records
from tasks.storage.store_url import open_store

_PAGE, _AGAIN, _FAILS_EACH = 100, 5, 50
_FIRST_S = 1.7e9
_PLACE = "lists of many jobs"


def main() -> None:
    """Measures, and prints the table or writes it into a document."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--s3-jobs", type=int, default=1_000)
    parser.add_argument("--document", type=Path)
    parser.add_argument("--page", nargs=3, metavar=("URL", "WHAT", "PLACE"))
    asked = parser.parse_args()
    if asked.page:
        sys.stdout.write(json.dumps(_timed_page(*asked.page)))
        return
    with tempfile.TemporaryDirectory(prefix="simyard-lists-") as name:
        table = _measured(Path(name), asked.jobs, asked.s3_jobs)
    text = f"{machine()}\n\n{table}"
    if asked.document:
        asked.document.write_text(with_tables(asked.document.read_text(), _PLACE, text))
    else:
        sys.stdout.write(f"{text}\n")


def _measured(folder: Path, jobs: int, s3_jobs: int) -> str:
    from tests.servers.seaweed import running_seaweed  # noqa: PLC0415 - only here

    rows = [["ms for a page of 100", "before, cold", "cold", "warm"]]
    singles, batch = (folder / "singles").as_uri(), (folder / "batch").as_uri()
    fill_singles(open_store(singles), jobs)
    rows += _rows(singles, f"folder, {jobs:,} single jobs", jobs)
    fill_batch(open_store(batch), jobs)
    rows += _rows(batch, f"folder, a batch of {jobs:,}", jobs)
    (folder / "seaweed").mkdir()
    with running_seaweed(folder / "seaweed") as server:
        os.environ.update(server.environment())
        server.make_bucket("lists")
        fill_singles(open_store("s3://lists/singles"), s3_jobs)
        rows += _rows("s3://lists/singles", f"SeaweedFS, {s3_jobs:,} single jobs", s3_jobs)
        fill_batch(open_store("s3://lists/batch"), s3_jobs)
        rows += _rows("s3://lists/batch", f"SeaweedFS, a batch of {s3_jobs:,}", s3_jobs)
    return markdown(rows)


def _rows(url: str, name: str, jobs: int) -> Iterator[list[str]]:
    before = _in_process(url, "before", "0")["first"]
    late = _in_process(url, "before", str(jobs - 2 * _PAGE))["first"]
    yield [f"{name}: the first list ever", f"{before:.0f}", f"{_in_process(url, 'jobs', '0')['first']:.0f}", ""]
    for what, place, was in (
        ("jobs", 0, before),
        ("jobs", jobs - 2 * _PAGE, late),
        ("failed", 0, 0.0),
        ("restarting", 0, 0.0),
        ("batches", 0, 0.0),
    ):
        found = _in_process(url, what, str(place))
        where = f" from {place:,} on" if place else ""
        yield [f"{name}: {what}{where}", f"{was:.0f}" if was else "", f"{found['first']:.0f}", f"{found['then']:.1f}"]


def _in_process(url: str, what: str, place: str) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.gateway.lists", "--page", url, what, place]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(answer.stdout)


def _timed_page(url: str, what: str, place: str) -> dict[str, float]:
    store = open_store(url)
    page = _page(store, what, int(place))
    times_ms: list[float] = []
    for _ in range(1 if what == "before" else 1 + _AGAIN):
        start_s = time.perf_counter()
        page()
        times_ms.append(1000 * (time.perf_counter() - start_s))
    return {"first": times_ms[0], "then": statistics.median(times_ms[1:] or times_ms)}


def _page(store: Store, what: str, place: int) -> Callable[[], object]:
    if what == "before":
        return lambda: list(islice(_before(store), place, place + _PAGE + 1))
    if what == "batches":
        return lambda: list_batches_page(store, ListSimulationJobBatchesRequest(maxResults=_PAGE))
    asked: dict[str, object] = {"maxResults": _PAGE, "nextToken": _token(store, place) if place else None}
    if what != "jobs":
        asked["filters"] = [{"name": "status", "values": [what.capitalize()]}]
    request = ListSimulationJobsRequest.model_validate({key: value for key, value in asked.items() if value})
    return lambda: list_jobs_page(store, request)


def _before(store: Store) -> Iterator[object]:
    """Yields the jobs as lists did before there were lines: all records, and then batch by batch."""
    for record in records(store, KIND):
        yield from Jobs(store, record.id).created()


def _token(store: Store, place: int) -> str | None:
    """Returns the token of the page that begins at a place, which the stores here let compute."""
    keys = store.keys(f"jobs/{KIND}")
    own = (0, keys[0].rpartition("/")[2].removesuffix(".json"), place - 1)
    if len(keys) > 1:
        job = job_id(KIND, f"job-{place - 1}")
        own = (round(1e6 * (_FIRST_S + place - 1)), job, 0)
    else:
        own = (round(1e6 * read(store, KIND, own[1]).created_at_s), own[1], place - 1)
    return page_of([(own, 0), (own, 1)], 1, "simulation-job")[1]


def fill_singles(store: Store, count: int) -> None:
    """Puts so many single jobs that have ended into a store, as an older version wrote them: without lines."""
    from tests.factories.planned_batches import plan, request  # noqa: PLC0415 - only here

    made = plan(store, seeds=(0,), worlds=("g/w0",))
    (entry,) = request(made)["createSimulationJobRequests"]  # pyright: ignore - a list of one document
    record = open_batch(store, made, entry, "model")  # pyright: ignore - as above
    bodies = [_chunk_bodies(store, record.id, failed=failed) for failed in (False, True)]
    model = close_batch(store, record.id, "Completed", {})
    with ThreadPoolExecutor(16) as pool:
        list(
            pool.map(lambda number: _put_single(store, model, number, bodies[number % _FAILS_EACH == 0]), range(count))
        )
    for key in (*store.keys("lines"), *store.keys(f"chunks/{record.id}"), job_key(KIND, record.id)):
        store.delete(key)


def _chunk_bodies(store: Store, batch: str, *, failed: bool) -> tuple[bytes, bytes]:
    from tests.factories.episodes import crashed, passed  # noqa: PLC0415 - only here

    begin_chunk(store, batch, 0, 0.0)
    store.delete(chunk_key(batch, 0))
    commit(store, batch, 0, [(crashed if failed else passed)(0)], load_batch(store, batch).voucher)
    return store.get(chunk_start_key(batch, 0)).body, store.get(chunk_key(batch, 0)).body


def _put_single(store: Store, model: JobRecord, number: int, chunk: tuple[bytes, bytes]) -> None:
    job, at_s = job_id(KIND, f"job-{number}"), _FIRST_S + number
    own = {"id": job, "arn": model.arn.replace(model.id, job), "token": f"job-{number}"}
    record = model.model_copy(update={**own, "created_at_s": at_s, "updated_at_s": at_s + 30})
    _put(store, job_key(KIND, job), encode_document(record))
    _put(store, chunk_start_key(job, 0), chunk[0])
    _put(store, chunk_key(job, 0), chunk[1])


def _put(store: Store, key: str, body: bytes) -> None:
    root = getattr(store, "root", None)
    if root is None:
        store.put(key, body)
        return
    path = Path(root) / key  # a folder of the benchmark's own: to flush each file would take minutes
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(body)


def fill_batch(store: Store, count: int) -> None:
    """Puts a batch of so many episodes that has ended into a store, without a line."""
    from tests.factories.episodes import crashed, passed  # noqa: PLC0415 - only here
    from tests.factories.planned_batches import plan, request  # noqa: PLC0415 - only here

    made = plan(store, seeds=tuple(range(count // 2)), lanes=256)
    batch = load_batch(store, open_batch(store, made, request(made), "batch").id)
    for number in range(batch.layout.chunks):
        begin_chunk(store, batch.id, number, 0.0)
        indices = [each.index for each in batch.layout.chunk(number).requests]
        rows = [(passed if index % _FAILS_EACH else crashed)(index) for index in indices]
        commit(store, batch.id, number, rows, batch.voucher)
    close_batch(store, batch.id, "Completed", {})
    for key in store.keys("lines"):
        store.delete(key)


if __name__ == "__main__":
    main()
