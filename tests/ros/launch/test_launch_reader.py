"""The program that reads a launch file is bounded, whatever a stranger wrote into the file."""

import os
import sys
import time
from pathlib import Path

import pytest

from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import read_apart
from tasks.ros.process.application_processes import alive


def read(folder: Path, program: str, limit_s: float = 60.0) -> str:
    return read_apart([sys.executable, "-I", "-S", "-c", program], dict(os.environ), folder, "asked", limit_s)


def test_the_last_line_is_the_answer(tmp_path: Path) -> None:
    assert read(tmp_path, "import sys; print('before'); print(sys.stdin.read())") == "asked"


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("import sys; sys.exit('no such thing')", "it fails: no such thing"),
        ("import os; os._exit(3)", "it fails: it says nothing"),
        ("import os; os._exit(0)", "it ends without an answer"),
        ("held = b'1' * (5 << 30)", "it fails: MemoryError"),
        ("import os\nwhile True: os.write(1, b'1' * (1 << 20))", "it fails: OSError: .*File too large"),
    ],
)
def test_whatever_goes_wrong_is_a_refusal_with_words(tmp_path: Path, program: str, why: str) -> None:
    with pytest.raises(LaunchRefused, match=why):
        read(tmp_path, program)


def test_it_ends_in_time(tmp_path: Path) -> None:
    with pytest.raises(LaunchRefused, match=r"reading it takes longer than 0\.2 s"):
        read(tmp_path, "import time; time.sleep(600)", 0.2)


def test_what_it_leaves_behind_is_ended_and_nobody_waits_for_it(tmp_path: Path) -> None:
    program = "import os, time\npid = os.fork()\nif pid: print(pid)\nelse: time.sleep(600)"
    left = int(read(tmp_path, program))
    while alive(left):
        time.sleep(0.002)
