"""Parts of an audit are driven at a time; an application's code runs on the thread that asks."""

import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.audit import audit_drive
from tasks.simulate.audit.audit_drive import Drives
from tasks.simulate.chunk.byproducts import ChunkWatch
from tests.factories.simulations import delivery

PATIENCE_S = 30.0
REQUESTS = [delivery(k, world="hand/apartment-0", seed=k) for k in range(6)]


class Run:
    """A run of two slices that notes which threads drive it."""

    def __init__(self, host: object = None, meanwhile: Callable[[], None] = lambda: None) -> None:
        self.host, self.threads, self._meanwhile = host, list[int](), meanwhile

    def begin(self) -> SimpleNamespace:
        return SimpleNamespace(done=np.array([False]))

    def advance(self, _state: object) -> tuple[SimpleNamespace, SimpleNamespace]:
        self.threads.append(threading.get_ident())
        if len(self.threads) == 2:
            self._meanwhile()
        return SimpleNamespace(done=np.array([len(self.threads) == 2])), SimpleNamespace(pose=np.zeros((1, 1, 3)))


def drive(monkeypatch: pytest.MonkeyPatch, runs: Callable[[], Iterator[Run]]) -> Mapping[int, object]:
    """Returns what comes of runs that are parts of one sample."""

    def ready(*_args: object, **_more: object) -> Iterator[SimpleNamespace]:
        for number, run in enumerate(runs()):
            yield SimpleNamespace(run=run, watch=ChunkWatch(), number=number)

    def driven(chunk: SimpleNamespace, *_more: object) -> list[SimpleNamespace]:
        return [SimpleNamespace(row=SimpleNamespace(index=chunk.number))]

    monkeypatch.setattr(audit_drive, "ready_parts", ready)
    monkeypatch.setattr(audit_drive, "most_lanes", lambda *_: None)
    monkeypatch.setattr(audit_drive, "_end", lambda state: state)
    monkeypatch.setattr(audit_drive, "_driven", driven)
    with Drives() as under_way:
        return under_way.begin(REQUESTS, {}, {"": Path()}, lanes=8, engine="planar")()


def test_parts_are_driven_at_a_time(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(audit_drive, "device_count", lambda: 2)
    met = threading.Barrier(2)

    found = drive(monkeypatch, lambda: (Run(meanwhile=lambda: _meet(met)) for _ in range(2)))

    assert sorted(found) == [0, 1]


def test_no_more_parts_are_under_way_than_there_are_cores(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(audit_drive, "device_count", lambda: 2)
    ends: list[None] = []
    most: list[int] = []

    def end() -> None:
        threading.Event().wait(0.01)
        ends.append(None)

    def runs() -> Iterator[Run]:
        for number in range(8):
            most.append(number - len(ends))
            yield Run(meanwhile=end)

    found = drive(monkeypatch, runs)

    assert sorted(found) == [*range(8)]
    assert max(most) == 2


def test_the_first_slice_is_driven_by_the_thread_that_asks(monkeypatch: pytest.MonkeyPatch):
    made = [Run(), Run()]

    drive(monkeypatch, lambda: iter(made))

    assert [run.threads[0] for run in made] == [threading.get_ident()] * 2
    assert all(run.threads[1] != threading.get_ident() for run in made)


def test_controllers_on_the_host_stay_on_the_thread_that_asks(monkeypatch: pytest.MonkeyPatch):
    closed: list[bool] = []
    run = Run(host=SimpleNamespace(close=lambda: closed.append(True)))

    drive(monkeypatch, lambda: iter([run]))

    assert run.threads == [threading.get_ident()] * 2
    assert closed == [True]


def test_what_one_part_raises_is_raised(monkeypatch: pytest.MonkeyPatch):
    def crash() -> None:
        raise BundleCrash("RobotApplicationCrash", "it raises")

    with pytest.raises(BundleCrash, match="it raises"):
        drive(monkeypatch, lambda: iter([Run(meanwhile=crash), Run()]))


def _meet(barrier: threading.Barrier) -> None:
    barrier.wait(PATIENCE_S)
