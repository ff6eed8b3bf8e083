"""docs/reference/results-schema.md says what the code does: every column, and queries that run."""

import html
import re
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pytest
import yaml

from specs.data.result_columns import SCHEMA_VERSION
from specs.field_types import BAG_ENDINGS
from specs.pipeline.simulation_section import Recordings
from tasks.results.tables.episode_tables import FAILURES, RESULTS, failures_table, results_table
from tasks.results.tables.parquet import write_parquet
from tasks.results.tables.recordings import recording_table
from tests.factories.episodes import batch, request
from tests.repository import ROOT
from tests.ros.bag.tracks import cameras, log, with_twist

DOCUMENT = (ROOT / "docs/reference/results-schema.md").read_text()
QUERIES = re.findall(r"```sql\n(.*?)```", DOCUMENT, re.DOTALL)
RECORDINGS = (ROOT / "docs/reference/recordings-schema.md").read_text()
RECORDING_QUERIES = re.findall(r"```sql\n(.*?)```", RECORDINGS, re.DOTALL)


def documented(heading: str, document: str = DOCUMENT) -> list[list[str]]:
    section = document.split(f"\n## {heading}\n")[1].split("\n## ", maxsplit=1)[0]
    rows = [line for line in section.split("\n") if line.startswith("| `")]
    return [[html.unescape(cell.strip()) for cell in row.strip("|").split("|")] for row in rows]


def test_every_topic_and_format_of_bags_is_documented():
    rows = documented("Bags", RECORDINGS)
    track = log(with_twist()._replace(cameras=cameras()))
    assert [(row[0].strip("`"), row[1].strip("`")) for row in rows if row[0].startswith("`/")] == [
        (channel.topic, channel.kind) for channel in track.channels
    ]
    assert [row[0].strip("`") for row in rows if not row[0].startswith("`/")] == list(BAG_ENDINGS)


def test_the_document_of_bags_is_one_that_simyard_takes():
    (text,) = re.findall(r"```yaml\n(simulationBatch:\n  recordings: .*bags.*\n)```", RECORDINGS)
    asked = yaml.safe_load(text)["simulationBatch"]["recordings"]
    assert Recordings.model_validate(asked).bags == tuple(BAG_ENDINGS)


def described(field: pa.Field) -> list[str]:
    metadata = field.metadata or {}
    null = ", null" if field.nullable else ""
    return [
        f"`{field.name}`",
        f"{field.type}{null}",
        metadata[b"unit"].decode() or "-",
        metadata[b"description"].decode(),
    ]


def test_every_column_of_the_results_is_documented():
    assert documented("results.parquet") == [described(field) for field in RESULTS]


def test_every_further_column_of_the_failures_is_documented():
    further = [field for field in FAILURES if field.name not in RESULTS.names]
    assert documented("failures.parquet") == [described(field) for field in further]


def test_the_version_is_documented():
    assert f"version {SCHEMA_VERSION} of their schema" in DOCUMENT


@pytest.mark.parametrize(
    ("sql", "place"), [*((sql, "simb-1") for sql in QUERIES), *((sql, ".") for sql in RECORDING_QUERIES)]
)
def test_the_queries_of_the_documents_run(sql: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    requests = [request(index, environment={"MAX_SPEED": "0.3"}) for index in range(6)]
    for folder in ("simb-1", "recordings/simb-1"):
        (tmp_path / folder).mkdir(parents=True)
    write_parquet(results_table("simb-1", requests, batch(3, 2, 1)), tmp_path / "simb-1/results.parquet")
    write_parquet(failures_table("simb-1", requests, batch(3, 2, 1)), tmp_path / "simb-1/failures.parquet")
    write_parquet(recording_table(_collision(3)), tmp_path / "recordings/simb-1/000000.parquet")
    monkeypatch.chdir(tmp_path / place)
    with duckdb.connect() as connection:
        assert connection.execute(sql).fetchall()


def test_there_are_queries():
    assert (len(QUERIES), len(RECORDING_QUERIES)) == (6, 3)


def _collision(index: int) -> dict[str, np.ndarray]:
    """Returns two samples of an episode, half a second before its end and there."""
    (result,) = (each for each in batch(3, 2, 1) if each.index == index)
    once = np.zeros((2, 3), np.float32)
    return {
        "index": np.array([index, index]),
        "t_s": np.array([result.simulated_s - 0.5, result.simulated_s]),
        "pose": once,
        "velocity": once,
        "goal_index": np.array([0, 0]),
        "acted": np.array([True, False]),
        "control": once,
        "ranges_m": once + 0.5,
        "impulse_ns": np.array([2.0, 0.0], np.float32),
    }
