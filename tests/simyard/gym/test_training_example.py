"""The training example trains, and its document gates what it trained."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simyard.gym.task_options import TaskOptions
from specs.bundle_files import ChoiceOutput
from specs.errors import SimyardError
from tasks.render.camera_pool import open_cameras
from tasks.simulate.host.policy_check import check_policy
from tests.repository import ROOT
from tests.servers.tools import skip_or_fail


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
    if sensor == "color":
        require_gl()
    bundle = tmp_path / "bundle"
    small = ["--rounds", "2", "--steps", "40", "--passes", "1", "--envs", "8", "--halls", "2"]
    command = ["examples/training/pictures.py", "--sensor", sensor, *small, "--output", str(bundle)]
    said = python(*command)
    assert len(re.findall(r"^round \d, .*% arrive$", said, re.MULTILINE)) == 2
    checked = check_policy(bundle, "seeing/seeing.onnx").policy
    fields = [part.field for each in checked.inputs for part in each.parts]
    assert fields == [field, "goal_robot_m", "goal_robot_m", "finder_m"]
    assert isinstance(checked.output, ChoiceOutput)
    assert min(forward for forward, _ in checked.output.controls) == 0.0, "it drives where it looks"
    assert [(each.input, each.output) for each in checked.states] == [("last_choice", "choice"), ("spun", "spun_next")]
    assert "<polyline" in (bundle / "curve.svg").read_text()
    sight = json.loads((bundle / "sight.json").read_text())
    assert len(sight) == 4
    assert all(0.0 <= share <= 1.0 for share in sight.values())


# The example's pupil learns made-up answers by heart, and is written.
BY_HEART = """
import sys
sys.path.insert(0, "examples/training")
import json, pathlib
import jax, numpy as np, onnxruntime
import pictures

sensors, part, channels = pictures.SENSORS["color"]
pupil, rng, folder = pictures.Pupil(part, channels, 0), np.random.default_rng(0), pathlib.Path("{folder}")
picture = rng.integers(0, 256, (48, 48, 64, 3), np.uint8)
told = rng.uniform(-1, 1, (48, 6)).astype(np.float32)
wanted = rng.integers(0, len(pictures.CONTROLS), 48)
pupil.learn([picture, told, wanted, rng.choice(np.float32([1, 3]), 48)], 150)
weights = jax.tree.map(np.asarray, pupil.weights_of(pupil.state))
pictures.write(folder, weights, sensors, part)
session = onnxruntime.InferenceSession(folder / "seeing" / "seeing.onnx")
mirrored = picture[:, :, ::-1], pictures.mirrored(told)
memory = pictures.no_memory(48)
best, _ = pictures.choice(weights, picture, told, memory)
mirror_best, _ = pictures.choice(weights, *mirrored, memory)
answers = [pictures.CONTROLS[np.asarray(each)] for each in (best, mirror_best)]
shown = {{"picture": picture / np.float32(255), "told": told}}


def answer(memory):
    remembered = {{"last_choice": memory[:, :-1], "spun": memory[:, -1:]}}
    said, *kept = session.run(["action", "choice", "spun_next"], {{**shown, **remembered}})
    expected = pictures.choice(weights, picture, told, memory)[1]
    return said, float(np.abs(np.concatenate(kept, axis=1) - expected).max())


said, *kept = answer(memory)
off = float(np.abs(said - pictures.scores(weights, picture, told)).max())
# Who has turned to the one side does not turn to the other at once, and who has turned for long had better drive.
memory[:, np.argmin(pictures.CONTROLS[:, 1])] = 1
held, *kept[1:] = answer(memory)
memory[:, :-1], memory[:, -1] = 0, 50
tired, *kept[2:] = answer(memory)
left, spot = pictures.CONTROLS[:, 1] > 0.5, pictures.CONTROLS[:, 0] == 0
print(json.dumps({{
    "learned": np.mean(answers[0] == pictures.CONTROLS[wanted]),
    "mirrored": np.mean(answers[1] == answers[0] * [1, -1]),
    "off": off,
    "kept": max(kept),
    "held_back": [float((held - said)[:, left].max()), float(np.abs(held - said)[:, ~left].max())],
    "tired": [float((tired - said)[:, spot].max()), float(np.abs(tired - said)[:, ~spot].max())],
}}))
"""


@pytest.mark.long
@pytest.mark.integration
def test_a_pupil_learns_each_answer_and_its_mirror_image_and_is_written_with_its_memory(tmp_path: Path):
    found = json.loads(python("-c", BY_HEART.format(folder=tmp_path)))
    assert found["learned"] > 0.95
    assert found["mirrored"] > 0.95
    assert found["off"] < 1e-3
    assert found["kept"] < 1e-4, "the network keeps what it has chosen, and for how long it has turned"
    assert found["held_back"] == [pytest.approx(-3.0, abs=1e-4), pytest.approx(0.0, abs=1e-4)]
    assert found["tired"] == [pytest.approx(-3.0, abs=1e-4), pytest.approx(0.0, abs=1e-4)]


# The tops of what stands in the example's halls, and the height at which its teacher looks.
TOPS = """
import sys
sys.path.insert(0, "examples/training")
import json
import pictures

things = [thing for world in pictures.halls(4, 0) for thing in world.furniture]
tops = {thing.model_type: solid.center_m[2] + solid.half_extents_m[2] for thing in things for solid in thing.solids}
print(json.dumps([tops, pictures.SCAN_M]))
"""


@pytest.mark.long
@pytest.mark.integration
def test_the_teacher_of_who_sees_pictures_looks_over_nothing_that_stands_in_the_halls():
    tops, scan_m = json.loads(python("-c", TOPS))
    assert set(tops) == {"box", "pallet"}
    assert scan_m < min(tops.values())


def python(*arguments: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def require_gl() -> None:
    try:
        with open_cameras(1):
            pass
    except SimyardError as exc:
        skip_or_fail(str(exc))


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
