"""docs/guide/robots.md: what it tells one to run is run, and what it says of the skid steer is measured."""

import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tasks.simulate.engines.engine_table import choose_engine
from tests.repository import ROOT

GUIDE = (ROOT / "docs" / "guide" / "robots.md").read_text()
(SHELL,) = re.findall(r"^```sh\n(.*?)^```", GUIDE, re.DOTALL | re.MULTILINE)
(SCRIPT,) = re.findall(r"^```python\n(.*?)^```", GUIDE, re.DOTALL | re.MULTILINE)
(URDF,) = re.findall(r"<!-- file: robot.urdf -->\n```xml\n(.*?)```", GUIDE, re.DOTALL)
SKID_STEER = ROOT / "examples" / "robots" / "skid-steer" / "robot.xml"
WHEEL_M, HALF_TRACK_M, TURN_RAD_S = 0.065, 0.13, 1.0


def test_the_script_makes_a_robot_of_the_urdf(tmp_path: Path):
    (tmp_path / "robot.urdf").write_text(URDF)
    subprocess.run([sys.executable, "-c", SCRIPT], cwd=tmp_path, check=True)
    choice = choose_engine("auto", tmp_path / "robot.xml", "jax", "cpu")
    assert choice.engine == "mujoco"
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")).body("chassis").mass == pytest.approx(4.0)


def turn_share(friction: str) -> float:
    """Returns how fast the skid steer turns on the spot, as a share of what its wheels' speeds say."""
    text = SKID_STEER.read_text().replace('friction="0.7"', f'friction="{friction}"')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[:] = np.array([-1.0, 1.0, -1.0, 1.0]) * HALF_TRACK_M * TURN_RAD_S / WHEEL_M
    rates: list[float] = []
    for step in range(800):
        mujoco.mj_step(model, data)
        if step >= 400:
            rates.append(float(data.qvel[5]))
    return float(np.mean(rates)) / TURN_RAD_S


def test_the_skid_steer_turns_by_the_share_that_the_guide_says():
    told = re.search(
        r'With `friction="(\S+)"` this robot turns at (\S+) of.*?at (\S+) it is about (\S+), and at (\S+) it',
        GUIDE,
        re.DOTALL,
    )
    assert told is not None
    friction, share, lower, more, higher = told.groups()
    assert turn_share(friction) == pytest.approx(float(share), abs=0.03)
    assert turn_share(lower) == pytest.approx(float(more), abs=0.08)
    assert turn_share(higher) < turn_share(friction)


@pytest.mark.soak
@pytest.mark.integration
def test_its_commands_run_line_by_line(tmp_path: Path):
    for name, target in ((".venv", Path(sys.prefix)), ("examples", ROOT / "examples")):
        (tmp_path / name).symlink_to(target)
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", SHELL], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "engine planar, the fastest of all" in done.stdout
    assert "16 of 16 episodes passed" in done.stdout
