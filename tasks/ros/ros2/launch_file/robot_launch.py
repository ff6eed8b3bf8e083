"""What stands for ``ros2 launch`` on a robot without: ``python -m`` this module, BUNDLE PACKAGE LAUNCH_FILE.

It starts what episodes start, by the wall's clock, and those with ``respawn`` anew. It ends when all nodes have ended,
or one whose end is the application's; whoever ends it ends its nodes.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchSource, NodePlan
from tasks.ros.ros2.launch_file.launch_description import SIMULATED_TIME, make_spaces, resolve_description
from tasks.ros.ros2.ros2_installation import ros2_installation

_END_S = 5.0
# A node that cannot run would take a core with starting.
_RESPAWN_S = 1.0


def main() -> int:
    """Launches a file of a bundle; returns the status of the first node that did not end with 0."""
    bundle, package, launch_file = sys.argv[1:]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    started: list[tuple[NodePlan, subprocess.Popen[bytes]]] = []
    with tempfile.TemporaryDirectory(prefix="simyard-launch-") as folder:
        try:
            source, installation = LaunchSource(Path(bundle), package, launch_file), ros2_installation()
            plan = resolve_description(source, dict(os.environ), Path(folder, "parameters"))
            spaces = make_spaces(source.bundle, installation, Path(folder, "packages"))
            own = {**os.environ, **installation.environment(spaces)}
            for node in plan.nodes:
                started.append((node, _start(node, own)))  # noqa: PERF401 - if one cannot be started, those before it end
            return _wait(started, own)
        except (LaunchRefused, OSError) as exc:
            sys.stderr.write(f"{exc}\n")
            return 1
        finally:
            _end([process for _, process in started])


def _start(node: NodePlan, environment: dict[str, str]) -> "subprocess.Popen[bytes]":
    command = node.command
    if command[-len(SIMULATED_TIME) :] == SIMULATED_TIME:
        command = command[: -len(SIMULATED_TIME)]
    process = subprocess.Popen(command, env={**environment, **node.own_environment()}, cwd=node.cwd or None)  # noqa: S603 - the bundle's own
    sys.stdout.write(f"process[{node.name.lstrip('/')}]: started with pid [{process.pid}]\n")
    sys.stdout.flush()
    return process


def _wait(started: "list[tuple[NodePlan, subprocess.Popen[bytes]]]", environment: dict[str, str]) -> int:
    """Waits for the end of all nodes, or of one that the launch file requires; starts those anew that are to be."""
    status, running = 0, {process.pid: node for node, process in started}
    while running:
        pid, code = os.wait()
        node = running.pop(pid, None)
        if node is None:
            continue
        ended = os.waitstatus_to_exitcode(code)
        sys.stdout.write(f"process[{node.name.lstrip('/')}]: ended with status {ended}\n")
        if node.required:
            return status or abs(ended)
        if node.respawn:
            time.sleep(_RESPAWN_S)
            place = next(number for number, (_, each) in enumerate(started) if each.pid == pid)
            started[place][1].poll()  # it has ended
            started[place] = (node, _start(node, environment))
            running[started[place][1].pid] = node
        else:
            status = status or abs(ended)
    return status


def _end(processes: "list[subprocess.Popen[bytes]]") -> None:
    """Ends nodes: politely, as ros2 launch does, and after a while for good."""
    for each in processes:
        each.send_signal(signal.SIGINT)
    for each in processes:
        try:
            each.wait(_END_S)
        except subprocess.TimeoutExpired:
            each.kill()


if __name__ == "__main__":
    sys.exit(main())
