"""The training example trains, and its document gates what it trained."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx.numpy_helper import to_array

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


def trained_on_pictures(program: list[str], bundle: Path, sensor: str, steps: int) -> subprocess.CompletedProcess[str]:
    missing = [name for name in ("skrl", "flax", "optax") if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)}: no part of Simyard: pip install skrl flax optax")
    asked = ["--sensor", sensor, "--steps", str(steps), "--envs", "8", "--output", str(bundle)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, *program, *asked]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize(("sensor", "field"), [("depth", "depth_m"), ("color", "color")])
def test_a_short_training_on_pictures_writes_a_policy_that_fits_its_robot(sensor: str, field: str, tmp_path: Path):
    bundle = tmp_path / "bundle"
    done = trained_on_pictures(["examples/training/pictures.py"], bundle, sensor, 1024)
    assert "1,024 steps" in done.stdout
    checked = check_policy(bundle, "seeing/seeing.onnx")
    assert [part.field for each in checked.policy.inputs for part in each.parts] == [field] + ["goal_robot_m"] * 2
    assert "<polyline" in (bundle / "curve.svg").read_text()


# The example, whose trials are told how many robots arrive, and which keeps the weights of each trial's network.
TRIALS_BY_ROTE = """
import sys
sys.path.insert(0, "examples/training")
import numpy as np
import pictures

shares, folder = iter([{shares}]), "{folder}/"

def trial(envs, policy):
    share = next(shares)
    np.save(f"{{folder}}{{share}}.npy", policy.state_dict.params["params"]["last"]["kernel"])
    return share

pictures.trial = trial
pictures.main()
"""


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize(("shares", "tried"), [("0.6, 0.2", [0.6, 0.2]), ("0.99", [0.99])])
def test_the_best_policy_of_all_trials_is_written_and_one_that_is_good_enough_ends_the_training(
    shares: str, tried: list[float], tmp_path: Path
):
    bundle = tmp_path / "bundle"
    trained_on_pictures(["-c", TRIALS_BY_ROTE.format(shares=shares, folder=tmp_path)], bundle, "depth", 2048)
    assert [each["trial"] for each in json.loads((bundle / "curve.json").read_text())] == tried
    kernels = [np.load(tmp_path / f"{share}.npy") for share in tried]
    (written,) = [
        each
        for each in map(to_array, onnx.load(bundle / "seeing" / "seeing.onnx").graph.initializer)
        if each.shape == kernels[0].shape
    ]
    assert [np.array_equal(written, each) for each in kernels] == [True, *[False] * (len(tried) - 1)]


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
