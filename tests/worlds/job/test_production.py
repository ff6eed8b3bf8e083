"""Any number of processes makes the same worlds, in the same order, and none of them outlives the job."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.job import production
from tasks.worlds.job.production import Indices, Order, WorkerDied, WorldOutcome, make, produce
from tests.worlds.templates import room, template

pytestmark = pytest.mark.long

ORDER = Order(
    template=template(room("A", area_m2=12.0), room("B", "Bedroom", 12.0)),
    seed=5,
    generation="wgj-1",
    robot_radius_m=0.25,
)
INDICES: list[Indices] = [(plan, interior) for plan in range(1, 13) for interior in (1, 2)]


def workers() -> set[int]:
    """Returns the processes that make worlds for this one.

    Of each process its parent is read: a thread's list of children, proc(5), leaves some out while a thread ends.
    """
    return {
        int(stat.parent.name)
        for stat in Path("/proc").glob("[0-9]*/stat")
        if parent(stat) == os.getpid() and b"popen_loky" in stat.with_name("cmdline").read_bytes()
    }


def parent(stat: Path) -> int | None:
    """Returns whose child a process is; None for one that has ended."""
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return None


@pytest.mark.parametrize("number", [2, pytest.param(3, marks=pytest.mark.long)])
def test_workers_make_what_one_process_makes_in_the_same_order(number: int) -> None:
    alone = list(produce(ORDER, INDICES, 1))
    assert [made.indices for made in alone] == INDICES
    assert list(produce(ORDER, INDICES, number)) == alone


def test_few_worlds_are_not_worth_a_process() -> None:
    products = produce(ORDER, INDICES)
    next(products)
    assert workers() == set()
    products.close()


def test_workers_end_when_nobody_wants_more() -> None:
    products = produce(ORDER, INDICES, 2)
    next(products)
    assert len(workers()) == 2
    products.close()
    assert workers() == set()


def test_a_killed_worker_is_an_error_that_names_its_signal() -> None:
    # More than workers are ever given ahead: however fast they are, some is left to ask of them when they are dead.
    products = produce(ORDER, [(plan, 1) for plan in range(1, 401)], 2)
    next(products)
    for pid in workers():
        os.kill(pid, signal.SIGKILL)
    with pytest.raises(WorkerDied, match="-9"):
        list(products)
    assert workers() == set()


@pytest.mark.long
def test_no_worker_outlives_a_killed_job() -> None:
    script = (
        "import sys, time; from tests.worlds.job.test_production import INDICES, ORDER, workers; "
        "from tasks.worlds.job.production import produce; products = produce(ORDER, INDICES, 2); next(products); "
        "print(*workers(), flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as job:
        assert job.stdout is not None
        left = [int(pid) for pid in job.stdout.readline().split()]
        job.kill()
    assert len(left) == 2
    for _ in range(300):
        if not any(_runs(pid) for pid in left):
            return
        signal.sigtimedwait([], 0.1)
    pytest.fail("a worker outlived its job")


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # it is gone, or went while it was read
        return False


def test_a_world_that_cannot_be_is_told_with_code_and_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def rejecting(*_: object, **__: object) -> None:
        raise WorldRejected("InvalidInput", "make a room larger")

    monkeypatch.setattr(production, "generate_world", rejecting)
    assert make(ORDER, (1, 1)) == WorldOutcome(indices=(1, 1), code="InvalidInput", reason="make a room larger")
