"""How fast `simyard serve` describes and lists, over HTTP on this machine, and how much memory it takes.

    .venv/bin/python -m benchmarks.gateway.requests [--requests N] [--store URL] [--json FILE]

The store is made for it: fleets, generation jobs, and a batch. Each row is one operation, asked by one client and then
by eight that keep their connections; the times are the clients'. Requests are not signed.
"""

import argparse
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import NamedTuple

from benchmarks.machine import machine
from benchmarks.results.trend_speed import store_night
from benchmarks.tables import markdown
from specs.arn import arn
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.simulate.batch.batch_record import KIND
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records, submit
from tasks.storage.store_url import open_store, store_id

FLEETS, GENERATIONS, CLIENTS = 100, 100, 8


class Asked(NamedTuple):
    """An operation's path and its request."""

    path: str
    request: dict[str, object]


class Row(NamedTuple):
    """What was measured of an operation asked by so many clients."""

    operation: str
    clients: int
    median_ms: float
    late_ms: float
    per_s: float


def filled(url: str | None, folder: Path) -> Store:
    """Returns a store with something of each kind that is asked for."""
    store = open_store(url or (folder / "store").as_uri())
    for number in range(FLEETS):
        create_fleet(store, f"fleet-{number}")
    template = arn("world-template", store_id(store), "t")
    for number in range(GENERATIONS):
        submit(store, "world-generation-job", {"template": template, "worldCount": {}}, f"g-{number}")
    store_night(store, 1)
    return store


def operations(store: Store) -> list[Asked]:
    """Returns what is asked."""
    own, batch = store_id(store), next(iter(records(store, KIND))).id
    generation = next(iter(records(store, "world-generation-job"))).id
    return [
        Asked("/ping", {}),
        Asked("/describeFleet", {"fleet": arn("deployment-fleet", own, "fleet-1")}),
        Asked("/describeWorldGenerationJob", {"job": arn("world-generation-job", own, generation)}),
        Asked("/describeSimulationJobBatch", {"batch": arn("simulation-job-batch", own, batch)}),
        Asked("/listFleets", {"maxResults": 100}),
        Asked("/listWorldGenerationJobs", {"maxResults": 100}),
        Asked("/listSimulationJobs", {"maxResults": 100}),
    ]


@contextmanager
def gateway(store: Store) -> Generator[tuple[subprocess.Popen[bytes], int]]:
    """Serves a store in a process of its own; yields it and its port once it answers."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    command = [sys.executable, "-m", "simyard", "serve", "--unsigned", "--workers", "0"]
    command += ["--port", str(port), "--store", store.url]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        while process.poll() is None and not _listens(port):
            time.sleep(0.01)
        yield process, port
    finally:
        process.terminate()
        process.wait()


def measured(port: int, asked: Asked, clients: int, requests: int) -> Row:
    """Returns how long requests took."""
    with ThreadPoolExecutor(clients) as pool:
        began_s = time.perf_counter()
        parts = pool.map(lambda _: _times(port, asked, requests // clients), range(clients))
        times = sorted(each for part in parts for each in part)
        took_s = time.perf_counter() - began_s
    late = times[min(len(times) - 1, round(0.99 * len(times)))]
    return Row(asked.path, clients, 1000 * statistics.median(times), 1000 * late, len(times) / took_s)


def resident_mb(process: subprocess.Popen[bytes]) -> float:
    """Returns the memory of a process."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _times(port: int, asked: Asked, count: int) -> list[float]:
    connection = HTTPConnection("127.0.0.1", port, timeout=60)
    body = json.dumps(asked.request).encode()
    method = "GET" if asked.path == "/ping" else "POST"
    found: list[float] = []
    for _ in range(count):
        began_s = time.perf_counter()
        connection.request(method, asked.path, body, {"content-type": "application/json"})
        answer = connection.getresponse()
        told = answer.read()
        found.append(time.perf_counter() - began_s)
        if answer.status != 200:
            raise SystemExit(f"{asked.path}: {answer.status} {told.decode()}")
    connection.close()
    return found


def _listens(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures and prints a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--requests", type=int, default=200)
    parser.add_argument("--store")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        store = filled(given.store, Path(folder))
        began_s = time.perf_counter()
        with gateway(store) as (process, port):
            start_s, before_mb = time.perf_counter() - began_s, resident_mb(process)
            asked = operations(store)
            rows = [measured(port, each, clients, given.requests) for each in asked for clients in (1, CLIENTS)]
            after_mb = resident_mb(process)
    head = ("operation", "clients", "median, ms", "99 %, ms", "requests/s")
    cells = [(r.operation, str(r.clients), f"{r.median_ms:.1f}", f"{r.late_ms:.1f}", f"{r.per_s:.0f}") for r in rows]
    print(markdown([head, *cells]))
    print(f"\nlistens after {start_s:.1f} s; {before_mb:.0f} MB then, {after_mb:.0f} MB after all of it. {machine()}")
    if given.json:
        given.json.write_text(json.dumps([row._asdict() for row in rows], indent=1))


if __name__ == "__main__":
    main()
