"""The end of a supervisor and of a lane, which comes with the end of their input."""

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
