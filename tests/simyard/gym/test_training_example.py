"""The example trains, writes a bundle that the gate's own check takes, and drives by it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tasks.simulate.host.policy_check import check_policy
from tests.repository import ROOT


@pytest.mark.long
@pytest.mark.integration
def test_a_short_training_writes_a_policy_that_fits_its_robot(tmp_path: Path):
    bundle = tmp_path / "bundle"
    command = [sys.executable, "examples/training/train.py", "--steps", "33000", "--output", str(bundle)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "32,768 steps" in done.stdout
    checked = check_policy(bundle, "reactive/reactive.onnx")
    assert [part.field for part in checked.policy.inputs[0].parts] == ["ranges_m", "ranges_m"] + ["goal_robot_m"] * 2
    assert os.access(bundle / "reactive" / "run.sh", os.X_OK)
