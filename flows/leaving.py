"""How `simyard` ends: exit codes, and what a person is told.

0 done and passed, 1 the gate or the deployment failed, 2 a bad document or command, 3 a stage failed or Simyard has a
defect, 130 and 143 interrupted. Never 1 for anything else: whoever ships on 0 must know a verdict from an accident.
"""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

from rich.console import Console
from rich.text import Text

from specs.errors import DocumentError, PipelineNotPassed, SimyardError

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_INTERRUPTED = tuple(128 + number for number in _SIGNALS)


def leave_after(command: Callable[[], object]) -> NoReturn:
    """Runs a command and ends the process with Simyard's exit code; tells on stderr what went wrong, in one message.

    Args:
        command: May end the process itself, as the parser does after a usage error.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as in `nohup` and for jobs in a script's background
            signal.signal(number, _interrupted)
    sys.exit(_code(command))


def _code(command: Callable[[], object]) -> int:
    try:
        command()
    except SystemExit as exc:
        if exc.code in _INTERRUPTED:
            _complain("interrupted; the same command continues this run")
        raise
    except PipelineNotPassed as exc:
        return _told(exc, 1)
    except DocumentError as exc:
        return _told(exc, 2)
    except SimyardError as exc:
        return _told(exc, 3)
    except Exception as exc:  # noqa: BLE001 - the outermost frame: Python would exit with 1, which means a failed gate
        if os.environ.get("SIMYARD_DEBUG") == "1":
            Console(stderr=True).print_exception()
        what = " ".join(f"{type(exc).__name__}: {exc}".split())
        return _told(f"this is a defect of Simyard: {what} (SIMYARD_DEBUG=1 shows where)", 3)
    return 0


def _interrupted(number: int, _frame: FrameType | None) -> NoReturn:
    # Not KeyboardInterrupt: the parser takes that for itself and says nothing.
    raise SystemExit(128 + number)


def _told(about: object, code: int) -> int:
    _complain(about)
    return code


def _complain(about: object) -> None:
    Console(stderr=True).print(Text(str(about), style="red"), soft_wrap=True)
