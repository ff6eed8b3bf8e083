"""Notes how each function of Simyard's is reached first, in a run and in the processes that it starts.

`benchmarks/house/house.py` puts this folder on Python's path: Python imports a module of this name before any other.
"""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import CodeType, FrameType

FOLDER, ROOT = "SIMYARD_TRACE_FOLDER", "SIMYARD_TRACE_ROOT"
_TOPS = ("specs", "tasks", "flows", "simyard")


def trace_calls(folder: Path, root: str) -> None:
    """Writes, for each function of Simyard's, the calls that led to it when it was called first.

    Args:
        folder: Gets a file of JSON lines for each process.
        root: The repository.
    """
    tops = tuple(f"{root}/{top}/" for top in _TOPS)
    seen: set[CodeType] = set()
    log = (folder / f"{os.getpid()}.jsonl").open("a", buffering=1)

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or code in seen or not code.co_filename.startswith(tops):
            return
        seen.add(code)
        calls: list[str] = []
        above: FrameType | None = frame
        while above:
            if above.f_code.co_filename.startswith(tops):
                calls.append(f"{above.f_code.co_filename.removeprefix(f'{root}/')}:{above.f_code.co_qualname}")
                if calls[-1].endswith("<module>") and above.f_globals.get("__name__") == "__main__":
                    break  # the program's own module; what confined it before runs another's
            above = above.f_back
        # What runs while a module is imported leads nowhere; the program's own module is the outermost.
        if not any(call.endswith("<module>") for call in calls[:-1]) and not calls[0].endswith("<module>"):
            log.write(json.dumps(calls[::-1]) + "\n")

    sys.setprofile(note)
    threading.setprofile(note)


def keep_in_children() -> None:
    """Lets also those processes note their calls that get an environment of their own."""
    kept = {name: os.environ[name] for name in (FOLDER, ROOT, "PYTHONPATH")}
    begin = subprocess.Popen.__init__

    def begin_traced(self: subprocess.Popen[bytes], *args: object, **kwargs: object) -> None:
        environment = kwargs.get("env")
        if isinstance(environment, dict):
            kwargs["env"] = {**environment, **kept}
        begin(self, *args, **kwargs)  # type: ignore[arg-type] - whatever it was given

    subprocess.Popen.__init__ = begin_traced  # type: ignore[method-assign] - for this measurement alone


if FOLDER in os.environ:
    trace_calls(Path(os.environ[FOLDER]), os.environ[ROOT])
    keep_in_children()
