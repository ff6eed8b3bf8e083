"""The audit drives a sample again on C MuJoCo, and finds what is wrong with rows."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.parity_audit import AuditReport
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.audit import audit_drive
from tasks.simulate.audit.audit_drive import Drives, drive_sample
from tasks.simulate.audit.audit_report import DrivenEpisode
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.chunk.byproducts import ChunkWatch
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.audits import audit
from tests.factories.simulations import FOLDERS, delivery, pushing, simulate_lanes
from tests.simulate.conftest import PUSHER_LANES, Simulate

REQUESTS = [delivery(k, world=f"hand/apartment-{k % 4}", seed=k, duration_s=20.0) for k in range(8)]


@pytest.fixture(scope="module")
def rows(deliver: Simulate) -> list[EpisodeResult]:
    return deliver(REQUESTS)


@pytest.fixture(scope="module")
def report(rows: list[EpisodeResult], apartments: dict[str, World]) -> AuditReport:
    return audit(sample(REQUESTS, rows), apartments, FOLDERS, lanes=8)


def sample(requests: Sequence[EpisodeRequest], rows: Sequence[EpisodeResult]) -> list[SampledEpisode]:
    return [SampledEpisode(request, row, 2.0) for request, row in zip(requests, rows, strict=True)]


@pytest.mark.long
def test_sound_rows_pass(report: AuditReport):
    assert (report.verdict, report.engine, report.lanes, report.compared) == ("SOUND", "planar", 8, 8)
    assert (report.flips, report.unreproduced, report.elsewhere) == ((), (), ())
    assert (report.false_passes.lanes + report.false_alarms.lanes, report.total.rate, report.control) == (8, 0.0, None)
    assert report.final
    assert report.way
    assert report.final.max_m < 1e-3
    assert (report.sampled, report.unflipped) == (8, report.way)
    assert 0.0 < report.way.median_m <= report.way.p90_m <= report.way.max_m < 1e-3


@pytest.mark.long
@pytest.mark.parametrize(
    "wrong",
    [
        {"final_x_m": 0.123},
        {"outcome": "Failed", "outcome_reason": "collision"},
        {"energy_j": 1e-6},
        {"goals_reached": 1},
        {"engine": "mjx"},
    ],
)
def test_a_wrong_row_is_found(rows: list[EpisodeResult], apartments: dict[str, World], wrong: dict[str, object]):
    tampered = [row.model_copy(update=wrong) if row.index == 5 else row for row in rows]
    found = audit(sample(REQUESTS[4:7], tampered[4:7]), apartments, FOLDERS, lanes=8)
    assert (found.verdict, found.unreproduced) == ("SUSPECT", (5,))
    if "outcome" in wrong:
        assert [(flip.index, flip.row, flip.reference) for flip in found.flips] == [(5, "collision", "Passed")]
        assert (found.false_passes.flips, found.false_alarms.flips, found.flips[0].chaotic) == (0, 1, False)
        assert found.control
        assert (found.control.lanes, found.control.drives, found.control.flips) == (3, 2, 0)
        assert found.unflipped != found.way
    if "final_x_m" in wrong:
        assert found.final
        assert found.final.max_m > 0.1


@pytest.mark.long
def test_rows_of_another_kind_of_device_are_compared_but_not_made_again(
    rows: list[EpisodeResult], apartments: dict[str, World]
):
    far = [row.model_copy(update={"device": "gpu", "energy_j": 1.0}) for row in rows[:2]]
    found = audit(sample(REQUESTS[:2], far), apartments, FOLDERS, lanes=8)
    assert (found.verdict, found.elsewhere, found.unreproduced, found.compared) == ("SOUND", (0, 1), (), 2)
    assert found.way is None


@pytest.mark.long
def test_rows_that_mujoco_made_are_made_again_and_not_called_evidence(pens: dict[str, World]):
    requests = [pushing(k, world=f"hand/pen-{k % 3}", seed=k) for k in range(4)]
    made = _mujoco(requests, pens)
    driven: list[int] = []
    drawn = sample(requests, made)
    found = audit(drawn, pens, FOLDERS, lanes=PUSHER_LANES, engine="mujoco", progress=driven.append)
    assert (found.verdict, found.engine, found.compared, found.unreproduced) == ("NOT COMPARED", "mujoco", 0, ())
    assert driven[-1] == 2 * len(requests)  # a full bar
    assert (found.final, found.way, found.total.rate) == (None, None, None)
    tampered = [row.model_copy(update={"energy_j": 1e-6}) for row in made[:1]]
    assert audit(sample(requests[:1], tampered), pens, FOLDERS, lanes=PUSHER_LANES, engine="mujoco").unreproduced


@pytest.mark.long
def test_an_application_that_crashes_now_is_told(push: Simulate, pens: dict[str, World]):
    requests = [pushing(0, world="hand/pen-0")]
    rows = push(requests)
    now = [pushing(0, world="hand/pen-0", launch="raising")]
    with pytest.raises(BundleCrash, match="RobotApplicationCrash"):
        audit(sample(now, rows), pens, FOLDERS, lanes=PUSHER_LANES)


def _mujoco(requests: list[EpisodeRequest], worlds: dict[str, World]) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(requests, PUSHER_LANES)
    return simulate_lanes(chunk, worlds, FOLDERS, lanes=PUSHER_LANES, engine="mujoco", should_stop=lambda: False)


@pytest.mark.long
def test_an_engine_that_leaves_out_furniture_is_found(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    empty = {name: world.model_copy(update={"furniture": ()}) for name, world in pens.items()}
    requests = [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=10.0) for k in range(PUSHER_LANES)]

    class WithoutFurniture(Drives):
        def begin(self, *args: object, engine: str, **more: object) -> Callable[[], dict[int, DrivenEpisode]]:
            asked, worlds, *others = args
            return super().begin(asked, worlds if engine == "mujoco" else empty, *others, engine=engine, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(audit_drive, "Drives", WithoutFurniture)
    made = drive_sample(requests, empty, FOLDERS, lanes=PUSHER_LANES, engine="planar")
    found = audit(sample(requests, [made[k].row for k in range(PUSHER_LANES)]), pens, FOLDERS, lanes=PUSHER_LANES)
    assert (found.verdict, found.unreproduced) == ("SUSPECT", ())
    assert found.control
    assert found.control.parted > 1
    assert "which stay together when they start a micrometre beside" in found.sentence


@pytest.mark.long
def test_the_control_is_the_same_again_and_a_micrometre_beside(pens: dict[str, World]):
    requests = [pushing(k, world=f"hand/pen-{k % 3}", seed=k) for k in range(2)]

    def driven(beside_m: tuple[float, float]) -> dict[int, DrivenEpisode]:
        return drive_sample(requests, pens, FOLDERS, lanes=PUSHER_LANES, engine="mujoco", beside_m=beside_m)

    one, again, straight = driven((1e-6, 0.0)), driven((1e-6, 0.0)), driven((0.0, 0.0))
    assert [each.row for each in one.values()] == [each.row for each in again.values()]
    first_m = one[0].places_m[0] - straight[0].places_m[0]
    assert 5e-7 < first_m[0] < 2e-6
    assert abs(first_m[1]) < 5e-7


DRIVEN_REQUESTS = [delivery(k, world="hand/apartment-0", seed=k) for k in range(6)]


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

    def driven(drive: SimpleNamespace, *_more: object) -> list[SimpleNamespace]:
        return [SimpleNamespace(row=SimpleNamespace(index=drive.chunk.number))]

    monkeypatch.setattr(audit_drive, "ready_parts", ready)
    monkeypatch.setattr(audit_drive, "most_lanes", lambda *_: None)
    monkeypatch.setattr(audit_drive, "_driven_episodes", driven)
    with Drives() as under_way:
        return under_way.begin(DRIVEN_REQUESTS, {}, {"": Path()}, lanes=8, engine="planar")()


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
    assert max(most) <= 2


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
    barrier.wait(600.0)
