"""Any number of processes makes the same worlds, in the same order, and none of them outlives the job."""

import json
import os
import signal
import subprocess
import sys
from io import BytesIO
from pathlib import Path

import pytest

from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.job import production
from tasks.worlds.job.production import Indices, Order, WorkerDied, WorldOutcome, make, produce
from tasks.worlds.job.worker_process import work
from tests.worlds.templates import room, template

pytestmark = pytest.mark.long

ORDER = Order(
    template=template(room("A", area_m2=12.0), room("B", "Bedroom", 12.0)),
    seed=5,
    generation="wgj-1",
    robot_radius_m=0.25,
)
INDICES: list[Indices] = [(plan, interior) for plan in range(1, 13) for interior in (1, 2)]


def children() -> set[int]:
    """Returns this process's children.

    Of each process its parent is read: a thread's list of children, proc(5), leaves some out while a thread ends.
    """
    return {int(stat.parent.name) for stat in Path("/proc").glob("[0-9]*/stat") if parent(stat) == os.getpid()}


def parent(stat: Path) -> int | None:
    """Returns whose child a process is; None for one that has ended."""
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return None


@pytest.mark.parametrize("workers", [2, pytest.param(3, marks=pytest.mark.long)])
def test_workers_make_what_one_process_makes_in_the_same_order(workers: int) -> None:
    alone = list(produce(ORDER, INDICES, 1))
    assert [made.indices for made in alone] == INDICES
    assert list(produce(ORDER, INDICES, workers)) == alone


def test_few_worlds_are_not_worth_a_process() -> None:
    before = children()
    products = produce(ORDER, INDICES)
    next(products)
    assert children() == before
    products.close()


def test_workers_end_when_nobody_wants_more() -> None:
    before = children()
    products = produce(ORDER, INDICES, 2)
    next(products)
    assert len(children() - before) == 2
    products.close()
    assert children() == before


def test_a_killed_worker_is_an_error_that_names_its_signal() -> None:
    # More than workers are ever given ahead: however fast they are, some is left to ask of them when they are dead.
    before = children()
    products = produce(ORDER, [(plan, 1) for plan in range(1, 401)], 2)
    next(products)
    for pid in children() - before:
        os.kill(pid, signal.SIGKILL)
    with pytest.raises(WorkerDied, match="-9"):
        list(products)
    assert children() == before


def test_a_worker_ends_with_its_input() -> None:
    asked = BytesIO(f"{ORDER.model_dump_json(exclude_unset=True)}\n[[1,1]]\n[[2,1],[2,2]]\n".encode())
    answers = BytesIO()
    work(asked, answers)
    first, *rest = answers.getvalue().splitlines()
    assert [made["indices"] for made in json.loads(first)] == [[1, 1]]
    assert [made["indices"] for made in json.loads(rest[1])] == [[2, 1], [2, 2]]
    documents = [json.loads(line)["name"] for line in (rest[0], *rest[2:])]
    assert documents == ["world-1-1", "world-2-1", "world-2-2"]


@pytest.mark.long
def test_no_worker_outlives_a_killed_job() -> None:
    script = (
        "import sys, time; from tests.worlds.job.test_production import INDICES, ORDER, children; "
        "from tasks.worlds.job.production import produce; products = produce(ORDER, INDICES, 2); next(products); "
        "print(*children(), flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as job:
        assert job.stdout is not None
        workers = [int(pid) for pid in job.stdout.readline().split()]
        job.kill()
    assert len(workers) == 2
    for _ in range(100):
        if not any(_runs(pid) for pid in workers):
            return
        signal.sigtimedwait([], 0.1)
    pytest.fail("a worker outlived its job")


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_world_that_cannot_be_is_told_with_code_and_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def rejecting(*_: object, **__: object) -> None:
        raise WorldRejected("InvalidInput", "make a room larger")

    monkeypatch.setattr(production, "generate_world", rejecting)
    assert make(ORDER, (1, 1)) == WorldOutcome(indices=(1, 1), code="InvalidInput", reason="make a room larger")
