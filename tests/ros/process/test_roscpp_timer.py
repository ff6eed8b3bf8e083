"""Which threads wait at a variable of roscpp's library, by programs that map a file of its name."""

import platform
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tasks.ros.process.thread_watch import keeps_timers

FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine(), 0)
PAGE = 4096
# The library's page, one of its variables that begin as zero, one of nobody, one of the program's own.
PROGRAM = f"""
import ctypes, os, sys
c = ctypes.CDLL(None)
c.mmap.restype = ctypes.c_void_p
c.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
c.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
first = c.mmap(None, 5 * {PAGE}, 0, 0x22, -1, 0)
c.mmap(first, {PAGE}, 3, 0x12, os.open(sys.argv[1], os.O_RDONLY), 0)
c.mprotect(first + {PAGE}, {PAGE}, 3)
c.mprotect(first + 3 * {PAGE}, {PAGE}, 3)
os.write(1, b".")
c.syscall(ctypes.c_long({FUTEX}), ctypes.c_void_p(first + int(sys.argv[2]) * {PAGE} + 64), 128, 0, None)
"""


def asleep(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "S"


@pytest.mark.skipif(not FUTEX, reason="the number of this machine's futex is not known here")
@pytest.mark.parametrize(
    ("library", "page", "expected"),
    [
        ("libroscpp.so.4d", 0, True),
        ("libroscpp.so.4d", 1, True),
        ("libroscpp.so.4d", 3, False),
        ("libother.so", 0, False),
        ("libother.so", 1, False),
    ],
)
def test_a_thread_keeps_timers_if_it_waits_at_a_variable_of_roscpps_library(
    tmp_path: Path, library: str, page: int, *, expected: bool
) -> None:
    file = tmp_path / library
    file.write_bytes(bytes(PAGE))
    command = [sys.executable, "-I", "-S", "-c", PROGRAM, str(file), str(page)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as waiting:
        assert waiting.stdout is not None
        assert waiting.stdout.read(1) == b"."
        while not asleep(waiting.pid):
            time.sleep(0.001)
        found = keeps_timers(waiting.pid, waiting.pid)
        waiting.kill()
    assert found is expected


def test_a_thread_that_is_gone_keeps_none() -> None:
    assert not keeps_timers(2**22 + 1, 2**22 + 1)
