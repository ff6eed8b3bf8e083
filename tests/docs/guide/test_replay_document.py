"""Whatever docs/guide/replay.md tells one to type, typed, from its first block to its last."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from tasks.results.playback.replay_mcap import TOPICS
from tests.integration.runs import ROOT

TEXT = (ROOT / "docs/guide/replay.md").read_text()
BLOCKS = re.findall(r"^```(sh|python|sql|yaml)\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_every_block_runs_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name, target in ((".venv", Path(sys.prefix)), ("examples", ROOT / "examples")):
        (tmp_path / name).symlink_to(target)
    shutil.copytree(ROOT / "applications", tmp_path / "applications", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.chdir(tmp_path)
    told = [_output(language, text) for language, text in BLOCKS]
    assert [language for language, _ in BLOCKS] == ["yaml", "sh", "sql", "sh", "python", "python", "sh", "sh", "sh"]
    (job, reason) = Path("job").read_text().split()[0], Path("reason").read_text()
    (columns,) = re.findall(r"deviation 0 in all \d+ columns, \d+ of its request not shown", TEXT)
    assert f"{job}: {reason}; {columns}" in told[3]
    assert sorted(path.name for path in Path("replayed").iterdir()) == [
        "replay-rosbag2",
        "replay.bag",
        "replay.mcap",
        "replay.svg",
    ]
    assert told[4].startswith("0.0 {")
    assert told[5].startswith("/odom 1.0 ")
    batch, _, index = job.partition("/")
    assert next(Path(".simyard/buckets/results").glob(f"**/bags/{batch}/{int(index):06d}.bag")).is_file()
    assert "of 12 pairs; difference" in told[6]
    assert f"{job}: {reason}, in " in told[7]
    assert told[8].startswith("shrunk/")
    assert "1 episode of at most" in told[8]


def test_every_topic_is_explained_with_its_schema():
    found = dict(re.findall(r"^\| `(/\w+)` \| `([\w.]+)` \|", TEXT, re.MULTILINE))
    assert found == TOPICS


def _output(language: str, text: str) -> str:
    if language == "yaml":
        Path("document.yaml").write_text(text)
        return ""
    if language == "sql":
        with duckdb.connect() as connection:
            rows = connection.execute(text).fetchall()
        Path("job").write_text(rows[0][0])
        Path("reason").write_text(rows[0][1])
        return "\n".join(map(str, rows))
    command = ["bash", "-euo", "pipefail", "-c", text] if language == "sh" else [sys.executable, "-c", text]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "300"})
    assert done.returncode == 0, done.stderr
    return done.stdout
