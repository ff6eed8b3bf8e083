"""The end of a supervisor and of a lane, which comes with the end of their input."""

import os
import signal
import subprocess
import sys
from pathlib import Path

_SWALLOWS = """
from flows.queue.supervisor import Orders
orders = Orders()
try:
    print("ready", flush=True)
    while True:
        pass
except KeyboardInterrupt:
    orders.wait(lambda: None)
"""


def test_a_lane_that_is_still_becoming_warm_ends_at_once(tmp_path: Path):
    lane = [sys.executable, "-m", "flows.queue.lane", "fleets", (tmp_path / "store").as_uri()]

    ended = subprocess.run(lane, stdin=subprocess.DEVNULL, check=False)

    assert ended.returncode == -signal.SIGTERM


def test_a_supervisor_whose_interrupt_was_swallowed_ends():
    supervisor = [sys.executable, "-c", _SWALLOWS]

    with subprocess.Popen(supervisor, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdout.readline()
        process.stdin.close()
        try:
            status = process.wait()
        finally:
            process.kill()

    assert status == 0


TOLD = """
import signal
from flows.queue import lane
from tests.every_line import signalled_at_each_line
lane.LOOK_S = 0.01
def begin():
    signals = lane.Signals()
    signal.signal(signal.SIGTERM, signals.end)
    def look():
        signals.forget()
        signals.wait()
    return look
print(signalled_at_each_line(begin) > 5)
"""


def test_a_worker_goes_on_wherever_in_its_wait_it_is_told_to_end() -> None:
    argv = [sys.executable, "-c", TOLD]
    told = subprocess.run(argv, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": "."})
    assert (told.stdout, told.stderr) == ("True\n", "")
