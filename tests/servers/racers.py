"""What child processes do in the races of the storage tests."""

import multiprocessing
import random
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.synchronize import Barrier
from pathlib import Path
from threading import Barrier as ThreadBarrier
from typing import TypeVar

from specs.errors import ObjectExists
from tasks.storage.jobs.records import submit
from tasks.storage.store_url import open_store

Result = TypeVar("Result")
_start: list[Barrier] = []


def in_processes(work: Callable[..., Result], arguments: Sequence[tuple[object, ...]]) -> list[Result]:
    """Returns the results of the work, done at once in as many new processes as there are arguments."""
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(len(arguments))
    with ProcessPoolExecutor(len(arguments), context, _wait_at, (start,)) as pool:
        return [future.result() for future in [pool.submit(work, *each) for each in arguments]]


def create_in_rounds(url: str, racer: int, threads: int, rounds: int) -> list[tuple[int, str]]:
    """Returns the rounds that this process won and as whom, racing all others for one key a round."""
    store = open_store(url)
    together = ThreadBarrier(threads, action=wait_for_all)

    def run(thread: int) -> list[tuple[int, str]]:
        won: list[tuple[int, str]] = []
        for number in range(rounds):
            me = f"{racer}-{thread}"
            together.wait()
            try:
                store.create(f"race/{number}", me.encode())
            except ObjectExists:
                continue
            won.append((number, me))
        return won

    with ThreadPoolExecutor(threads) as pool:
        return [win for wins in pool.map(run, range(threads)) for win in wins]


def missed_names(url: str, keys: list[str], writes: bool, seconds: float) -> int:  # noqa: FBT001 - sent to a process
    """Returns how many keys listings left out; or writes over all of them again and again, for others that list."""
    store = open_store(url)
    wait_for_all()
    end_s, missed = time.monotonic() + seconds, 0
    while time.monotonic() < end_s:
        if not writes:
            missed += len(set(keys) - set(store.keys("k")))
            continue
        for key in random.sample(keys, 50):
            store.put(key, b"1")
    return missed


def submit_together(url: str, token: str) -> str:
    """Returns, as JSON, the job that this process got for the token when all submitted at once."""
    store = open_store(url)
    wait_for_all()
    return submit(store, "world-generation-job", {"template": "rooms"}, token).model_dump_json()


def upload(url: str, key: str, source: str) -> None:
    """Uploads a file; the test kills the process meanwhile."""
    open_store(url).upload(key, Path(source))


def wait_for_all() -> None:
    _start[0].wait()


def _wait_at(start: Barrier) -> None:
    _start.append(start)
