"""A signal at each line of a call, in whatever library it is: a handler must never wait for what it interrupts."""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any


def signalled_at_each_line(begin: Callable[[], Callable[[], object]]) -> int:
    """Makes a call as often as it has lines, with SIGTERM at another one each time; returns how many these are.

    Args:
        begin: Returns the call, with its handler of SIGTERM in place.
    """
    lines = 0
    while True:
        call, left = begin(), lines

        def trace(_frame: FrameType, event: str, _argument: object) -> Any:  # noqa: ANN401 - as sys.settrace has it
            nonlocal left
            if event == "line":
                if left == 0:
                    os.kill(os.getpid(), signal.SIGTERM)
                left -= 1
            return trace

        sys.settrace(trace)
        try:
            call()
        finally:
            sys.settrace(None)
        if left >= 0:
            return lines
        lines += 1
