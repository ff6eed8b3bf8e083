"""What the process that simulates answers when something goes wrong in it."""

import socket

import pytest

from tasks.simulate.application.code import BundleCrash
from tasks.simulate.audit import audit_drive
from tasks.simulate.process.wire import receive
from tasks.simulate.process.work import AuditWork, SentWorlds
from tasks.simulate.simulation_process import Service

WORK = AuditWork(sample=(), worlds=SentWorlds(new={}), bundles={}, lanes=8, engine="auto", drawn=0)


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

    monkeypatch.setattr(audit_drive, "audit", fails)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        Service(theirs).answer(WORK)
        document = receive(ours).document
    assert document["kind"] == kind
    assert said in str(document)
