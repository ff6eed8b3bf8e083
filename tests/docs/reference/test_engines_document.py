"""Whatever docs/reference/engines.md tells one to type, typed, from its first block to its last."""

import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from tests.integration.runs import ROOT

BLOCKS = re.findall(
    r"^```(sh|sql|yaml)\n(.*?)^```$", (ROOT / "docs/reference/engines.md").read_text(), re.DOTALL | re.MULTILINE
)


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_every_block_runs_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name, target in ((".venv", Path(sys.prefix)), ("examples", ROOT / "examples")):
        (tmp_path / name).symlink_to(target)
    monkeypatch.chdir(tmp_path)
    told = [_output(language, text) for language, text in BLOCKS]
    assert [language for language, _ in BLOCKS] == ["yaml", "sh", "sql"]
    assert "courier: engine mujoco, asked for" in told[1]
    assert told[2].startswith("('mujoco', 'cpu', 8, ")


def _output(language: str, text: str) -> str:
    if language == "yaml":
        Path("document.yaml").write_text(text)
        return ""
    if language == "sql":
        with duckdb.connect() as connection:
            return "\n".join(map(str, connection.execute(text).fetchall()))
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
