"""What the command `simyard` does before it imports anything: an interrupt from here on ends it quietly, with 130.

It needs nothing that is not in Python's core. `signal` itself would import modules for some milliseconds.
"""

import _signal  # pyright: ignore[reportMissingImports] - typeshed knows `signal` alone
import os
import sys
from itertools import pairwise

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

_ENDING = (2, 15)
"""SIGINT and SIGTERM."""


def is_command() -> bool:
    """Returns whether this process is the command `simyard`, started by its name or with `python -m`."""
    started = sys.argv[0] if sys.argv else ""
    if started == "-m":  # as long as Python looks for the module
        return any(pair == ("-m", "simyard") for pair in pairwise(sys.orig_argv))
    return os.path.basename(started) == "simyard"  # noqa: PTH119 - pathlib takes milliseconds, too


def leave_quietly() -> None:
    """Ends the process without a traceback when it is interrupted, until somebody else cares."""
    for number in _ENDING:
        if _signal.getsignal(number) is not _signal.SIG_IGN:
            _signal.signal(number, _leave)


def _leave(number: int, _frame: "FrameType | None") -> None:
    os.write(2, b"interrupted before anything began\n")
    os._exit(128 + number)
