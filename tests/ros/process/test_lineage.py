"""Which processes belong to which episode, and whose orphans are adopted."""

import ctypes
import os
import subprocess
from pathlib import Path

from tasks.ros.process.application_processes import ProcessTracker

_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37


def adopts() -> bool:
    asked = ctypes.c_int()
    ctypes.CDLL(None).prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(asked), 0, 0, 0)
    return bool(asked.value)


def test_orphans_are_adopted_until_the_last_lineage_is_closed():
    before = adopts()
    first, second = ProcessTracker(), ProcessTracker()
    assert adopts()
    first.close()
    first.close()
    assert adopts()
    second.close()
    assert adopts() == before


def test_a_process_of_an_episode_is_known_until_it_is_forgotten(tmp_path: Path):
    lineage = ProcessTracker()
    lineage.add(os.getpid(), tmp_path)
    assert lineage.processes(tmp_path) == [os.getpid()]
    lineage.forget([tmp_path])
    assert lineage.processes(tmp_path) == []
    lineage.close()


def test_strays_are_no_children_of_before_none_of_this_session_and_nobody_elses():
    def child(*, session: bool) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(["sleep", "600"], start_new_session=session)

    before = child(session=True)
    lineage = ProcessTracker()
    own, stray = child(session=False), child(session=True)
    assert lineage.strays() == [stray.pid]
    other = ProcessTracker()
    assert lineage.strays() == other.strays() == []
    for each in (other, lineage):
        each.close()
    for each in (before, own, stray):
        each.kill()
        each.wait()
