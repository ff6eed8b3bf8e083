"""What a program leaves behind is ended, however it tries to get away; each of these ends by itself after a while."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_ENDS = "$end = time + 20; sub on { time < $end or exit } "
STORMS = {
    "forks and exits": f"perl -e '{_ENDS} while (1) {{ on; fork && exit; select(undef, undef, undef, 0.0005) }}'",
    "forks into sessions of their own": (
        f"perl -e 'use POSIX; {_ENDS} while (1) {{ on; fork && POSIX::_exit(0); setsid(); select(undef, undef, undef, "
        "0.0005) }'"
    ),
    "forgets its variables in four chains": (
        f"env -i perl -e 'fork; fork; {_ENDS} while (1) {{ on; fork && exit; select(undef, undef, undef, 0.0005) }}'"
    ),
    "makes up the mark of another run": (
        f"env -i SIMYARD_RUN=made-up perl -e '{_ENDS} fork && exit; while (1) {{ on; select(undef, undef, undef, 0.1) "
        "}'"
    ),
    "starts again what is killed": (
        f'perl -e \'{_ENDS} $SIG{{TERM}} = "IGNORE"; while (1) {{ on; my $c = fork; if (!$c) {{ while (1) {{ on; '
        "select(undef, undef, undef, 0.01); getppid() == 1 and fork } } waitpid($c, 0) }'"
    ),
}
# An agent's process: it adopts orphans, starts the storm, ends it, and says what is left.
AGENT = """
import sys, time
from pathlib import Path
from tasks.deploy.robot.processes import end_all, reap_orphans, start
from tasks.deploy.robot.processes import adopt_orphans, orphans
adopt_orphans()
root = Path(sys.argv[1])
running = start(["/bin/sh", "-c", sys.argv[2]], root, {"PATH": "/usr/bin:/bin"}, root, root / "log")
for _ in range(25):
    time.sleep(0.02)
    reap_orphans()
running.end() if sys.argv[3] == "end" else end_all(root)
running.end()
time.sleep(0.05)
print(len(orphans(())))
"""


@pytest.mark.parametrize("how", ["end", "end_all"])
@pytest.mark.parametrize("storm", STORMS)
def test_nothing_is_left_of_what(storm: str, how: str, tmp_path: Path) -> None:
    argv = [sys.executable, "-c", AGENT, str(tmp_path), STORMS[storm], how]

    told = subprocess.run(argv, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": "."})

    assert told.stdout == "0\n"
    assert _marked(tmp_path) == []


TOLD = """
from tasks.deploy.robot.processes import Stop, StopRequested
from tests.every_line import signalled_at_each_line
def begin():
    stop = Stop()
    stop.listen()
    def sleep():
        try:
            stop.sleep(0.01)
        except StopRequested:
            pass
    return sleep
print(signalled_at_each_line(begin) > 5)
"""


def test_an_agent_ends_wherever_in_its_sleep_it_is_told_to() -> None:
    argv = [sys.executable, "-c", TOLD]
    told = subprocess.run(argv, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": "."})
    assert (told.stdout, told.stderr) == ("True\n", "")


def _marked(root: Path) -> list[str]:
    mark = f"SIMYARD_ROBOT_ROOT={root}".encode()
    return [each.name for each in Path("/proc").glob("[0-9]*") if mark in _environment(each)]


def _environment(process: Path) -> bytes:
    try:
        return (process / "environ").read_bytes()
    except OSError:
        return b""
