"""What a command and its processes took is looked at while it runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.process_times import run_watched

HOLDS = "import time; held = bytearray(120 << 20); time.sleep({}); import sys; print('told', file=sys.stderr)"
STARTS = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLDS.format(0.6)!r}, 'tasks.server.x'])"


def test_the_most_memory_of_each_kind_of_process_is_known(tmp_path: Path):
    ran = run_watched([sys.executable, "-c", STARTS], os.environ, tmp_path, look_s=0.05)
    assert ran.held_mb["server"] > 2 * ran.held_mb["run"]
    assert ran.lines == ["told\n"]


def test_a_command_that_fails_is_no_measurement(tmp_path: Path):
    with pytest.raises(subprocess.CalledProcessError):
        run_watched([sys.executable, "-c", "raise SystemExit(3)"], os.environ, tmp_path)
