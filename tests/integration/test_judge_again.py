"""What docs/guide/gate.md says of judging again, on the batch that a run has left."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.runs import ROOT

pytestmark = pytest.mark.integration


def test_the_commands_of_the_document_judge_again_and_leave_the_runs_evidence(small_run: Path, tmp_path: Path):
    shutil.copytree(small_run / ".simyard", tmp_path / ".simyard", symlinks=True)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    (tmp_path / ".venv").symlink_to(sys.prefix)
    (evidence,) = (tmp_path / ".simyard").rglob("evidence.json")
    before = evidence.read_bytes()
    (block,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/guide/gate.md").read_text(), re.DOTALL)
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("INCONCLUSIVE: ")
    assert "its run said PASS" in done.stdout
    assert evidence.read_bytes() == before
    assert [path.name[:6] for path in sorted(evidence.parent.iterdir())][-1:] == ["later-"]
