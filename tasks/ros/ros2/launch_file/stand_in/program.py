"""The program that evaluates a launch file with the stand-ins, in a process of its own: ``python -m`` this module.

It reads a request from standard input, as JSON: the launch file, the packages, the folder for parameter files; and
writes what the launch file starts, or why it does not, as the last line of standard output.
"""

import json
import os
import sys
import traceback
from pathlib import Path
from typing import Any

from tasks.ros.ros2.launch_file.stand_in.action import described, visit_all
from tasks.ros.ros2.launch_file.stand_in.context import LaunchContext, NotDone, Package
from tasks.ros.ros2.launch_file.stand_in.module_table import install_modules

# Names that Simyard sets for this program's own sake.
_OWN = ("PYTHONPATH", "PYTHONSAFEPATH")


def _processes(request: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns what the launch file starts."""
    packages = {name: Package(**each) for name, each in request["packages"].items()}
    context = LaunchContext(packages, Path(request["folder"]))
    install_modules(context)
    context.enter(request["file"])
    visit_all(described(request["file"]), context)
    return context.processes


def _why(exc: BaseException, file: str) -> str:
    """Returns a fault of a launch file for a person: where in it, and what."""
    lines = [each.lineno for each in traceback.extract_tb(exc.__traceback__) if each.filename == file]
    place = f"line {lines[-1]}: " if lines else ""
    if isinstance(exc, NotDone):
        return f"{place}{exc}"
    if isinstance(exc, ModuleNotFoundError):
        return f"{place}it imports {exc.name}, which is not here: install ROS 2 and the packages that it needs"
    return f"{place}{type(exc).__name__}: {exc}"


def main() -> None:
    """Evaluates one launch file."""
    request = json.load(sys.stdin)
    for name in _OWN:
        os.environ.pop(name, None)
    try:
        answer: dict[str, Any] = {"processes": _processes(request)}
    except (Exception, SystemExit) as exc:  # noqa: BLE001 - whatever the launch file raises is its own
        answer = {"refused": " ".join(_why(exc, request["file"]).split())}
    sys.stdout.write(f"\n{json.dumps(answer)}\n")


if __name__ == "__main__":
    main()
