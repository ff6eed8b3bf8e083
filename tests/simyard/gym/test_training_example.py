"""The training example trains, and its document gates what it trained."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simyard.gym.task_options import TaskOptions
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


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize(("sensor", "field"), [("depth", "depth_m"), ("color", "color")])
def test_a_short_training_on_pictures_writes_a_policy_that_fits_its_robot(sensor: str, field: str, tmp_path: Path):
    missing = [name for name in ("skrl", "flax", "optax") if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)}: no part of Simyard: pip install skrl flax optax")
    bundle = tmp_path / "bundle"
    asked = ["--sensor", sensor, "--steps", "256", "--envs", "8", "--output", str(bundle)]
    command = [sys.executable, "examples/training/pictures.py", *asked]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    checked = check_policy(bundle, "seeing/seeing.onnx")
    assert [part.field for each in checked.policy.inputs for part in each.parts] == [field] + ["goal_robot_m"] * 2


DOCUMENT = ROOT / "docs/guide/training.md"
TEXT = DOCUMENT.read_text()


@pytest.mark.long
@pytest.mark.integration
def test_every_block_of_python_runs_in_one_program(tmp_path: Path):
    program = "\n".join(re.findall(r"^```python\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE))
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "MINARI_DATASETS_PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "'ranges_m': (32,)" in done.stdout
    assert "8 episodes" in done.stdout
    assert (tmp_path / "simyard" / "delivery" / "straight-v0" / "data").is_dir()


def test_every_option_is_in_the_table():
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|", TEXT, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named == set(TaskOptions.__annotations__) - {"store"}
