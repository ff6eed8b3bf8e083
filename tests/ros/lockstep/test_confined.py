"""Lock-step works where application code is shut in, as it does in a simulation."""

import os
import subprocess
from pathlib import Path

import pytest

from tasks.simulate.sandbox.confinement import confined_command, confined_environment, confinement
from tests.repository import ROOT

PROGRAM = """
import sys, tempfile
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tasks.ros.lockstep.exchange import Launch
from tests.ros.lockstep.room import drive
home = Path(tempfile.mkdtemp()) / "home"
environment = [{"KIND": kind} for kind in ("none", "port", "port")]
found = drive(Launch(Path(sys.argv[1]), "courier", "fault.launch", home, environment), [0, 0, 0], 20)
print(sorted(found.failures), len(set(found.digests)), [tuple(tally) for tally in found.tallies], home.exists())
"""


@pytest.mark.long
@pytest.mark.skipif(
    confinement().level != "bubblewrap" and os.environ.get("CI") != "true", reason=confinement().why or "there"
)
def test_lanes_are_driven_in_bubblewrap_each_in_a_network_of_its_own(courier: Path, tmp_path: Path) -> None:
    programs = tmp_path / "programs"
    programs.mkdir()
    arguments = ["-c", PROGRAM, str(courier), str(ROOT)]
    command = confined_command(arguments, programs, [courier, ROOT / "tests", ROOT / "tasks", ROOT / "specs"])
    environment = confined_environment(os.environ, programs)
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200, check=False)
    assert done.stdout == "[] 1 [(20, 0, 0), (20, 0, 0), (20, 0, 0)] False\n", done.stderr[-2000:]
