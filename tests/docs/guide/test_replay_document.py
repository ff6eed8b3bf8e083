"""Whatever docs/guide/replay.md tells one to type, typed, from its first block to its last."""

import ast
import re
import shutil
from pathlib import Path

import pytest

from tasks.results.playback.replay_mcap import BOXES_TOPICS, PEOPLE_TOPICS, ROBOTS_TOPICS, TOPICS
from tests.docs.typed_blocks import begin_in, blocks_of, typed
from tests.repository import ROOT

TEXT = (ROOT / "docs/guide/replay.md").read_text()
BLOCKS = blocks_of("docs/guide/replay.md")


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_every_block_runs_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    begin_in(tmp_path, monkeypatch)
    shutil.copytree(ROOT / "applications", tmp_path / "applications", ignore=shutil.ignore_patterns("__pycache__"))
    told = list[str]()
    for language, text in BLOCKS:
        told.append(typed(language, text))
        if language == "sql":  # what the blocks below are about
            job_arn, why, *_ = ast.literal_eval(told[-1].splitlines()[0])
            Path("job").write_text(job_arn)
            Path("reason").write_text(why)
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
    assert found == TOPICS | PEOPLE_TOPICS | ROBOTS_TOPICS | BOXES_TOPICS
