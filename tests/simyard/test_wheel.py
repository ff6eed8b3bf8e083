"""What is built of the checkout works without it: in another folder, with nothing but the wheel on the path."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.docs.tree import ROOTS
from tests.repository import ROOT

USE = """
import simyard
run = simyard.run("worlds-only.yaml", direct=True)
print(simyard.__file__, run.passed, len(simyard.worlds(run)))
print(simyard.plan("quickstart.yaml"))
"""


def test_every_package_is_in_the_wheel_and_the_command_leads_through_the_check():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert sorted(project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]) == sorted(ROOTS)
    assert project["project"]["scripts"] == {"simyard": "simyard.__main__:main"}


@pytest.mark.soak
def test_a_wheel_works_in_another_folder(tmp_path: Path):
    uv, site = str(Path(sys.executable).with_name("uv")), str(tmp_path / "site")
    subprocess.run([uv, "build", "--wheel", "--out-dir", str(tmp_path), str(ROOT)], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("simyard-*.whl")
    install = [uv, "pip", "install", "--python", sys.executable, "--no-deps", "--target", site, str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    shutil.copytree(ROOT / "examples", tmp_path / "elsewhere")
    environment = {name: value for name, value in os.environ.items() if name != "SIMYARD_STORE"}
    done = subprocess.run(
        [sys.executable, "-c", USE],
        cwd=tmp_path / "elsewhere",
        env={**environment, "PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{tmp_path}/site/simyard/__init__.py True 2\n")
    assert "courier: engine planar" in done.stdout
