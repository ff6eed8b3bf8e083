"""The clock of calls, for the process that watches."""

from mmap import mmap

import pytest

from tasks.simulate.application import bundle_code
from tasks.simulate.application.bundle_code import CLOCK_BYTES, CallWatchdog, running_call
from tasks.simulate.sandbox.simulator import timeout_of


def test_the_clock_of_a_call_stands_still_while_nodes_work(monkeypatch: pytest.MonkeyPatch):
    now_s = [100.0]
    monkeypatch.setattr(bundle_code.time, "monotonic", lambda: now_s[0])
    memory = mmap(-1, CLOCK_BYTES)
    clock = CallWatchdog(memory)
    with clock.call("slice", "", "a slice"):
        now_s[0] += 1.0
        with clock.call("nodes", "RobotApplicationCrash", "a control step"):
            now_s[0] += 50.0
            nodes = running_call(memory)
        now_s[0] += 2.0
        whole = running_call(memory)
    assert nodes is not None
    assert whole is not None
    assert [(each.kind, each.seconds) for each in (nodes, whole)] == [("nodes", 50.0), ("slice", 3.0)]
    assert running_call(memory) is None


def test_nodes_have_a_limit_of_their_own():
    memory = mmap(-1, CLOCK_BYTES)
    with CallWatchdog(memory).call("nodes", "RobotApplicationCrash", "a control step of 8 ROS applications"):
        call = running_call(memory)
    assert call is not None
    assert timeout_of(call._replace(seconds=400.0)) == ""
    assert "a control step of 8 ROS applications took longer than 900 s" in timeout_of(call._replace(seconds=901.0))
