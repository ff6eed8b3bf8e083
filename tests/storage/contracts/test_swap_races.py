"""Up to eight processes at once: what a store acknowledged is there exactly once, on a folder and a real S3 server."""

import logging
import multiprocessing
import signal
import time
from collections.abc import Sequence
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from tasks.storage.base.store import Store
from tests.servers.racers import in_processes
from tests.servers.swap_racers import (
    Race,
    RaceNotes,
    append_for,
    appended,
    doubled,
    lock_for,
    read_and_put_for,
)

_LOG = logging.getLogger(__name__)


def raced(store: Store, race: Race, keys: list[str], processes: int, seconds: float) -> list[RaceNotes]:
    """Returns what processes did at once, none of which saw what must not be."""
    told = in_processes(race, [(store.url, f"p{each}", keys, seconds) for each in range(processes)])
    operations, acknowledged = sum(each.operations for each in told), sum(len(each.done) for each in told)
    _LOG.info("%s, %s: %d operations, %d acknowledged", race.__name__, store.url[:4], operations, acknowledged)
    assert [wrong for each in told for wrong in each.wrong] == []
    return told


def done_by(told: Sequence[RaceNotes]) -> list[str]:
    return [done for each in told for done in each.done]


# Threads of one process race in `test_store_contract` whenever tests are run.
pytestmark = pytest.mark.long
lasting = pytest.mark.parametrize(("processes", "seconds"), [(3, 0.4), pytest.param(8, 12.0, marks=pytest.mark.soak)])


@lasting
def test_what_many_processes_append_is_there_once_and_in_order(store: Store, processes: int, seconds: float) -> None:
    keys = ["lists/a", "lists/b", "lists/c"]
    told = raced(store, append_for, keys, processes, seconds)
    found = appended(store, [key for key in keys if store.exists(key)])
    assert (sorted(found), doubled(found)) == (sorted(done_by(told)), [])
    for number, each in enumerate(told):
        for key in keys:
            mine = [item for item in found if item.startswith(f"{key} p{number}-")]
            assert mine == [item for item in each.done if item.startswith(f"{key} ")]


@lasting
def test_what_is_made_and_removed_and_made_again_is_never_taken_for_what_it_was(
    store: Store, processes: int, seconds: float
) -> None:
    keys = ["locks/a", "locks/b", "locks/c", "locks/d"]
    done = done_by(raced(store, lock_for, keys, processes, seconds))
    counts = {key: int(store.get(f"{key}-count").body) for key in set(done)}
    assert counts == {key: done.count(key) for key in counts}
    assert not [key for key in keys if store.exists(key)]


@lasting
def test_no_reader_sees_bytes_of_two_writers(store: Store, processes: int, seconds: float) -> None:
    keys = ["bodies/a", "bodies/b"]
    assert set(done_by(raced(store, read_and_put_for, keys, processes, seconds))) <= set(keys)


@pytest.mark.parametrize(
    ("processes", "kills", "apart_s"), [(3, 3, 0.3), pytest.param(8, 30, 0.7, marks=pytest.mark.soak)]
)
def test_what_was_acknowledged_to_processes_that_are_killed_is_there_once(
    store: Store, tmp_path: Path, processes: int, kills: int, apart_s: float
) -> None:
    keys, log = ["lists/a", "lists/b"], tmp_path / "log"
    log.touch()
    _kill_again_and_again(store, keys, log, processes=processes, kills=kills, apart_s=apart_s)
    lines = log.read_text().splitlines()
    tried, done = (
        {line.removeprefix(f"{what} ") for line in lines if line.startswith(f"{what} ")} for what in ("try", "done")
    )
    found = appended(store, [key for key in keys if store.exists(key)])
    _LOG.info("killed %d, %s: %d operations, %d acknowledged", kills, store.url[:4], len(tried), len(done))
    assert (doubled(found), done - set(found), set(found) - tried) == ([], set(), set())
    assert len(set(found) - done) <= kills + processes  # at most one each whose answer was never noted
    assert store.unfinished("lists") == [] or store.url.startswith("file:")


def _kill_again_and_again(
    store: Store, keys: list[str], log: Path, *, processes: int, kills: int, apart_s: float
) -> None:
    """Lets processes append, of which one after another is killed and replaced, and at last all."""
    context = multiprocessing.get_context("spawn")

    def begin(number: int) -> SpawnProcess:
        process = context.Process(target=append_for, args=(store.url, f"k{number}", keys, 600.0, str(log)), daemon=True)
        process.start()
        return process

    live = [begin(number) for number in range(processes)]
    try:
        while log.stat().st_size < 2000 and all(each.is_alive() for each in live):
            time.sleep(0.1)
        for number in range(kills):
            time.sleep(apart_s)
            live[0].kill()
            live[0].join()
            assert live.pop(0).exitcode == -signal.SIGKILL
            if number < kills - processes:
                live.append(begin(processes + number))
    finally:
        for each in live:
            each.kill()
            each.join()
