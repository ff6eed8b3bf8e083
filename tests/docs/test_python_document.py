"""Whatever docs/guide/python.md tells one to type, typed, from its first block to its last in one program."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import simyard
from tests.repository import ROOT

DOCUMENT = ROOT / "docs/guide/python.md"
TEXT = DOCUMENT.read_text()
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the environment and the examples, as a clone has them."""
    (tmp_path / ".venv").symlink_to(Path(sys.prefix))
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    return tmp_path


@pytest.mark.long
@pytest.mark.integration
def test_every_block_of_python_runs_in_one_program(folder: Path):
    program = "\n".join(text for language, text in BLOCKS if language == "python")
    done = _done([sys.executable, "-c", program], folder)
    for told in ("worldGeneration   2 worlds", "name | ", "simulationBatch Completed", "<World 'wgj-", "True"):
        assert told in done
    assert "(0 wishes" not in done


@pytest.mark.soak
@pytest.mark.integration
def test_the_shell_block_makes_a_page_of_the_notebook(folder: Path):
    (text,) = (text for language, text in BLOCKS if language == "sh")
    _done(["bash", "-euo", "pipefail", "-c", text], folder)
    page = (folder / "first-hour.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 3


def test_no_block_is_left_out():
    assert {language for language, _ in BLOCKS} == {"python", "sh"}


def test_every_call_is_in_the_table():
    named = re.findall(r"^\| `simyard\.(\w+)\(", TEXT, re.MULTILINE)
    assert sorted(named) == sorted(simyard.__all__)


def _done(command: list[str], folder: Path) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "SIMYARD_STORE"}
    done = subprocess.run(
        command,
        cwd=folder,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout
