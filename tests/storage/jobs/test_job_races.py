"""Up to eight processes advance the same jobs and take the same claims, on a folder and a real S3 server."""

import logging
import multiprocessing
import time
from collections import Counter
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import read, submit
from tests.servers.racers import in_processes
from tests.servers.swap_racers import JOB, advance_for, claim_for, doubled

_LOG = logging.getLogger(__name__)
# Threads and two processes race in `test_records` and `test_claim` whenever tests are run.
pytestmark = pytest.mark.long
lasting = pytest.mark.parametrize(("processes", "seconds"), [(3, 0.4), pytest.param(8, 10.0, marks=pytest.mark.soak)])


@lasting
def test_every_detail_that_was_acknowledged_stands_in_the_record_and_all_see_one_end(
    store: Store, processes: int, seconds: float
) -> None:
    ids = [submit(store, JOB, {"template": "t"}, token).id for token in ("a", "b")]
    told = in_processes(advance_for, [(store.url, f"p{each}", ids, seconds) for each in range(processes)])
    assert [wrong for each in told for wrong in each.wrong] == []
    done = [done.partition(" ")[::2] for each in told for done in each.done if " ended by " not in done]
    _LOG.info("advance, %s: %d acknowledged", store.url[:4], len(done))
    for wanted in ids:
        record = read(store, JOB, wanted)
        assert record.detail.keys() == {detail for job, detail in done if job == wanted} | {"ended_by"}
        ends = {done for each in told for done in each.done if done.startswith(f"{wanted} ended by ")}
        assert ends == {f"{wanted} ended by {record.detail['ended_by']}"}


@lasting
def test_one_process_at_a_time_has_a_claim_and_no_epoch_comes_twice(
    store: Store, processes: int, seconds: float
) -> None:
    keys = [claim_key(JOB, f"wgj-{number}") for number in range(3)]
    told = in_processes(claim_for, [(store.url, f"p{each}", keys, seconds) for each in range(processes)])
    done = [done for each in told for done in each.done]
    _LOG.info("claim, %s: %d taken", store.url[:4], len(done))
    taken = Counter(each.partition(" ")[0] for each in done)
    assert sorted(done) == sorted(f"{key} {epoch + 1}" for key, count in taken.items() for epoch in range(count))
    assert {key: int(store.get(f"counts/{key}").body) for key in taken} == taken


@pytest.mark.parametrize(("processes", "kills"), [(3, 3), pytest.param(8, 40, marks=pytest.mark.soak)])
def test_claims_of_killed_processes_are_taken_over_by_one_other_each(
    store: Store, tmp_path: Path, processes: int, kills: int
) -> None:
    keys, epochs = [claim_key(JOB, f"wgj-{number}") for number in range(2)], tmp_path / "epochs"
    epochs.touch()
    _kill_holders(store, keys, tmp_path, processes, kills)
    found = epochs.read_text().splitlines()
    _LOG.info("claims of %d killed, %s: %d taken", kills, store.url[:4], len(found))
    assert doubled(found) == []
    assert not (tmp_path / "wrong").exists()
    for key in keys:
        with hold_claim(store, key) as claim:
            seen = [int(line.split()[1]) for line in found if line.startswith(f"{key} ")]
            assert claim.epoch > max(seen, default=0)


def _kill_holders(store: Store, keys: list[str], folder: Path, processes: int, kills: int) -> None:
    """Lets processes take claims, and kills one after another, each replaced by a new one until enough are dead."""
    context = multiprocessing.get_context("spawn")

    def begin(number: int) -> SpawnProcess:
        process = context.Process(
            target=claim_for, args=(store.url, f"k{number}", keys, 600.0, str(folder)), daemon=True
        )
        process.start()
        return process

    live = [begin(number) for number in range(processes)]
    try:
        while (folder / "epochs").stat().st_size < 500 and all(each.is_alive() for each in live):
            time.sleep(0.05)
        for number in range(kills):
            time.sleep(0.4)
            assert live[0].is_alive()
            live[0].kill()
            live.pop(0).join()
            if number < kills - processes:
                live.append(begin(processes + number))
    finally:
        for each in live:
            each.kill()
            each.join()
