"""Runs a program that reads a launch file, which a stranger may have written: with bounds on time, memory and output.

Reading a launch file runs what it says. What that starts and leaves behind is ended with the program.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from specs.errors import LaunchRefused

_MEMORY_BYTES = 4 << 30
# Of each file that it writes, what it prints among them.
_WRITTEN_BYTES = 64 << 20
_LAST_BYTES = 4000


def read_apart(command: Sequence[str], environment: Mapping[str, str], folder: Path, text: str, limit_s: float) -> str:
    """Returns the last line that a program prints.

    Args:
        command: Of the program.
        environment: All that it has.
        folder: Where it runs, and may write.
        text: What it reads.
        limit_s: How long it may take.

    Raises:
        LaunchRefused: It cannot be started, takes too long, fails, or prints nothing; says why.
    """
    with tempfile.TemporaryFile(dir=folder) as out, tempfile.TemporaryFile(dir=folder) as errors:
        try:
            process = subprocess.Popen(  # noqa: S603 - a program of Simyard's own
                [*_limits(), *command],
                env=environment,
                cwd=folder,
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=errors,
                start_new_session=True,
            )
        except (OSError, ValueError) as exc:
            raise LaunchRefused(f"it cannot be started: {exc}") from exc
        if _status(process, text, limit_s):
            said = _last_bytes(errors).splitlines() or ["it says nothing"]
            raise LaunchRefused(f"it fails: {said[-1][:1000]}")
        out.seek(0)
        lines = out.read().decode("utf-8", "replace").splitlines()
    if not lines:
        raise LaunchRefused("it ends without an answer")
    return lines[-1]


def _status(process: "subprocess.Popen[bytes]", text: str, limit_s: float) -> int:
    """Returns how a program ended that is given a text; all that it leaves in its session is ended."""
    try:
        process.communicate(text.encode(), timeout=limit_s)
    except subprocess.TimeoutExpired as exc:
        raise LaunchRefused(f"reading it takes longer than {limit_s:g} s") from exc
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return process.returncode


def _limits() -> tuple[str, ...]:
    program = shutil.which("prlimit")
    if program is None:
        return ()
    return (program, f"--as={_MEMORY_BYTES}", f"--fsize={_WRITTEN_BYTES}", "--core=0:0", "--")


def _last_bytes(file: IO[bytes]) -> str:
    file.seek(max(0, file.seek(0, os.SEEK_END) - _LAST_BYTES))
    return file.read().decode("utf-8", "replace").strip()
