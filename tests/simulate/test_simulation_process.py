"""What the process that simulates answers when something goes wrong in it."""

import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.audit import audit_drive
from tasks.simulate.audit.audit_report import AuditDrives
from tasks.simulate.chunk import chunk_simulation
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.sandbox.process_environment import process_environment
from tasks.simulate.sandbox.protocol import QUESTION, AuditWork, Defect, LanesWork, SentWorlds, receive
from tasks.simulate.sandbox.simulator import SimulatorDefect
from tasks.simulate.simulation_process import Service
from tests.factories.simulations import delivery

LANES = 8
WORK = AuditWork(here=(), others=(), worlds=SentWorlds(new={}), bundles={}, lanes=8, engine="auto")


# What it imports is waited for by the first chunk; forms of documents are a tenth of that.
ASK = """
import sys
from tasks.simulate.devices import prepare_devices
prepare_devices()
import tasks.simulate.simulation_process
import tasks.simulate.chunk.chunk_simulation
print(*(name for name in sys.modules if name.startswith("specs.pipeline.") or name == "mujoco.glfw"))
"""


@pytest.mark.long
def test_it_imports_no_forms_of_documents_and_nothing_to_draw_with():
    environment = process_environment(os.environ, Path("/programs"))
    done = subprocess.run([sys.executable, "-c", ASK], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    ("error", "kind", "said"),
    [
        (BundleCrash("RobotApplicationCrash", "no module x"), "crashed", "no module x"),
        (MemoryError("9 GB"), "no-memory", "9 GB"),
        (RuntimeError("RESOURCE_EXHAUSTED: 9 GB"), "no-memory", "RESOURCE_EXHAUSTED: 9 GB"),
        (RuntimeError("a defect"), "defect", "RuntimeError: a defect"),
    ],
)
def test_a_lack_of_memory_a_crash_and_a_defect_are_different_answers(
    monkeypatch: pytest.MonkeyPatch, error: Exception, kind: str, said: str
):
    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(audit_drive, "drive_audit", fails)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        Service(theirs).answer(WORK)
        document = receive(ours, QUESTION).document
    assert document["kind"] == kind
    assert said in str(document)


def test_a_defect_is_the_exception_and_not_what_jax_adds_to_each(monkeypatch: pytest.MonkeyPatch):
    def fails(*_: object, **__: object) -> None:
        error = ImportError("Please install 'flatbuffers'")
        error.add_note("For simplicity, JAX has removed its internal frames from the traceback.")
        raise error

    monkeypatch.setattr(audit_drive, "drive_audit", fails)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        Service(theirs).answer(WORK)
        defect = Defect.model_validate(receive(ours, QUESTION).document)
    assert str(SimulatorDefect(defect)) == "ImportError: Please install 'flatbuffers'"
    assert "For simplicity" in defect.text


@pytest.mark.parametrize(("episodes", "ahead", "refilled"), [(1, 0, False), (2, 0, False), (3, 0, True), (1, 1, True)])
def test_few_episodes_with_nothing_after_them_are_driven_by_themselves(
    monkeypatch: pytest.MonkeyPatch, episodes: int, ahead: int, *, refilled: bool
):
    assert [given is not None for given in _pipelines(monkeypatch, [_lanes(episodes, ahead)])] == [refilled]


def test_few_episodes_of_a_batch_that_is_under_way_stay_with_it(monkeypatch: pytest.MonkeyPatch):
    first, last = _pipelines(monkeypatch, [_lanes(8, 1), _lanes(1, 0)])
    assert first is not None
    assert last is first


def test_nothing_that_was_begun_early_outlives_an_audit(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(audit_drive, "drive_audit", lambda *_, **__: AuditDrives({}, {}))
    first, after = _pipelines(monkeypatch, [_lanes(8, 1), WORK, _lanes(8, 0)])
    assert after is not None
    assert after is not first


def _pipelines(monkeypatch: pytest.MonkeyPatch, works: Sequence[LanesWork | AuditWork]) -> list[object]:
    """Returns what of lanes under way each question about lanes was simulated with."""
    given: list[object] = []

    def simulate(*_: object, pipeline: object, **__: object) -> EpisodeColumns:
        given.append(pipeline)
        return EpisodeColumns.of([])

    monkeypatch.setattr(chunk_simulation, "simulate_episodes", simulate)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        service = Service(theirs)
        for work in works:
            service.answer(work)
    return given


def _lanes(episodes: int, ahead: int) -> LanesWork:
    chunk = Chunk(number=0, requests=tuple(delivery(k, world="hand/apartment-0", seed=k) for k in range(episodes)))
    chunks = tuple(chunk.model_copy(update={"number": number}) for number in range(1 + ahead))
    return LanesWork(
        numbers=tuple(range(1 + ahead)),
        new=chunks,
        worlds=SentWorlds(new={}),
        bundles={},
        lanes=LANES,
        engine="auto",
    )
