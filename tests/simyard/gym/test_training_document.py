"""Whatever docs/guide/training.md shows in Python runs in one program, and its table has every option."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simyard.gym.task_options import TaskOptions
from tests.repository import ROOT

DOCUMENT = ROOT / "docs/guide/training.md"
TEXT = DOCUMENT.read_text()


@pytest.mark.long
@pytest.mark.integration
def test_every_block_of_python_runs_in_one_program(tmp_path: Path):
    program = "\n".join(re.findall(r"^```python\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE))
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "'ranges_m': (32,)" in done.stdout
    assert "8 episodes" in done.stdout
    assert (tmp_path / "straight-ahead" / "meta" / "info.json").is_file()


def test_every_option_is_in_the_table():
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|", TEXT, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named == set(TaskOptions.__annotations__) - {"store"}


def test_every_link_leads_somewhere():
    links = re.findall(r"\]\(([^)#:]+)", TEXT)
    assert [link for link in links if not (DOCUMENT.parent / link).exists()] == []
