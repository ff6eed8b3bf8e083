"""Threads as the kernel would tell of them, in a folder that stands for ``/proc``: a test says who runs."""

import dataclasses
from pathlib import Path


@dataclasses.dataclass
class FakeThread:
    """What the kernel tells of one thread.

    Args:
        folder: Where its files are.
    """

    folder: Path
    state: str = "S"
    ran_ns: int = 0
    waited_ns: int = 0
    runs: int = 0
    waits_at: str = "futex_wait_queue"
    call: str = ""

    def run(self, times: int = 1, *, ran_ns: int = 1000, waited_ns: int = 0) -> None:
        """Lets it run and sleep again, after it waited for a core for some time."""
        self.ran_ns, self.waited_ns, self.runs = self.ran_ns + ran_ns, self.waited_ns + waited_ns, self.runs + times
        self.be("S")

    def nap(self) -> None:
        """Lets it sleep by the wall's clock from now on."""
        self.waits_at = "hrtimer_nanosleep"
        self.be("S")

    def be(self, state: str) -> None:
        """Puts it into a state, such as ``R`` for a thread that is awake."""
        self.state = state
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "stat").write_text(f"1 (node) {state} 1 1")
        (self.folder / "schedstat").write_text(f"{self.ran_ns} {self.waited_ns} {self.runs}\n")
        (self.folder / "wchan").write_text(self.waits_at)
        if self.call:
            (self.folder / "syscall").write_text(self.call)


def fake_thread(proc: Path, pid: int, tid: int) -> FakeThread:
    """Returns a thread that sleeps, and was run never."""
    found = FakeThread(proc / str(pid) / "task" / str(tid))
    found.be("S")
    return found
