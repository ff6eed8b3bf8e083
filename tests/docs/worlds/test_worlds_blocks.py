"""Whatever docs/guide/worlds.md tells one to type, typed, from its first block to its last."""

import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from tests.integration.runs import ROOT, finished

BLOCKS = re.findall(
    r"^```(sh|python|sql|yaml)\n(.*?)^```$", (ROOT / "docs/guide/worlds.md").read_text(), re.DOTALL | re.MULTILINE
)


@pytest.mark.long
@pytest.mark.integration
def test_every_block_runs_in_order(prefect_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name, target in ((".venv", Path(sys.prefix)), ("examples", ROOT / "examples")):
        (tmp_path / name).symlink_to(target)
    monkeypatch.chdir(tmp_path)
    for language, text in BLOCKS:
        assert _output(language, text).strip()


def test_there_are_blocks_of_each_language():
    assert {language for language, _ in BLOCKS} == {"sh", "python", "sql", "yaml"}


def _output(language: str, text: str) -> str:
    if language == "sql":
        with duckdb.connect() as connection:
            rows = connection.execute(text).fetchall()
        return "\n".join(map(str, rows))
    if language == "yaml":
        Path("document.yaml").write_text(text)
        done = finished("plan", "document.yaml")
    else:
        command = ["bash", "-euo", "pipefail", "-c", text] if language == "sh" else [sys.executable, "-c", text]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
