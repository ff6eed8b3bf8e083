"""Becomes another program that the kernel ends when its parent dies, however the parent dies.

Run as ``python -m tasks.server.bound_child PARENT_PID PROGRAM ARGUMENT...``. The setting survives ``exec``, so the
program need not know about it; nothing is left behind by ``kill -9`` of the parent.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main(arguments: list[str]) -> None:
    """Replaces this process by a program bound to its parent.

    Args:
        arguments: The parent's process id, then the program and its arguments.

    Raises:
        SystemExit: The parent is gone already.
        OSError: The kernel refuses the setting, or the program cannot be started.
    """
    parent, program = int(arguments[0]), arguments[1:]
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG) failed")
    # The parent may have died before the setting took effect.
    if os.getppid() != parent:
        raise SystemExit(f"parent {parent} is gone")
    os.execv(program[0], program)  # noqa: S606 - no shell is wanted; the caller built the list


if __name__ == "__main__":
    main(sys.argv[1:])
