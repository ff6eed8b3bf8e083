"""The process that a gateway keeps: begun again when it dies, bound by its input."""

import os
import signal
import sys
from collections.abc import Generator

import pytest

from flows.queue.supervisor import KeptProcess, QueueWorkers
from tests.servers.eventually import eventually

_READS = [sys.executable, "-S", "-c", "import os\nwhile os.read(0, 1): pass"]


@pytest.fixture
def kept() -> Generator[KeptProcess]:
    """A process that reads its input to the end."""
    process = KeptProcess(_READS, "a reader")
    yield process
    process.end()


def test_a_process_that_is_killed_begins_again(kept: KeptProcess):
    first = kept.pid

    os.kill(first, signal.SIGKILL)

    assert eventually(lambda: kept.pid != first)


def test_a_process_ends_with_its_input_and_stays_ended():
    process = KeptProcess(_READS, "a reader")
    pid = process.pid

    process.end()

    assert not os.path.exists(f"/proc/{pid}")  # noqa: PTH110 - a process, not a file
    assert process.pid == pid


def test_a_process_that_does_not_read_holds_up_nobody(kept: KeptProcess):
    os.kill(kept.pid, signal.SIGSTOP)

    for _ in range(100_000):  # more than a pipe holds
        kept.wake()

    os.kill(kept.pid, signal.SIGCONT)


def test_no_workers_start_nothing():
    with QueueWorkers("file:///nowhere", workers=0) as workers:
        workers.wake()
