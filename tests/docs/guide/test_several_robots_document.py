"""docs/guide/several-robots.md: what it says of the document is what the document takes, and a run shows it."""

import re
import shutil
import time
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import yaml

from specs.data.result_columns import RESULTS_COLUMNS
from specs.data.robots import BLOCKED_M, MOST_ROBOTS, STILL_M, STILL_S
from specs.pipeline.gate_section import Gate
from specs.pipeline.simulation_section import SimulationBatch
from tasks.simulate.chunk.robot_starts import APART_M, ATTEMPTS
from tests.docs.typed_blocks import blocks_in
from tests.integration.runs import finished, simyard, small_document, write_document
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/several-robots.md").read_text()
BLOCKS: list[dict[str, Any]] = [yaml.safe_load(block) for block in blocks_in(DOCUMENT, "yaml")]
EXAMPLE = yaml.safe_load((ROOT / "examples/several-robots.yaml").read_text())


def test_a_document_takes_robots_as_the_page_writes_them():
    alone, among = (block["simulationBatch"] for block in BLOCKS if "simulationBatch" in block)
    section = SimulationBatch.model_validate({**EXAMPLE["simulationBatch"], **alone})
    assert section.robots == EXAMPLE["simulationBatch"]["robots"] == 3
    assert SimulationBatch.model_validate({**EXAMPLE["simulationBatch"], **among}).people == among["people"] == 10


def test_a_gate_takes_the_rule_that_the_page_writes():
    (block,) = (block["gate"] for block in BLOCKS if "gate" in block)
    assert Gate.model_validate(block).quantiles


def test_the_page_names_the_columns_of_robots():
    measured = DOCUMENT.partition("## What is measured")[2].partition("## ")[0]
    named = re.findall(r"^\| `(\w+)` \|", measured, flags=re.MULTILINE)
    known = [column.name for column in RESULTS_COLUMNS]
    own = {"robots", "robot", "robot_contacts", "robot_contact_m_s", "min_robot_m"}
    assert named == [name for name in known if name in own]


def test_the_page_has_the_numbers_that_hold():
    assert f"It takes 1 to {MOST_ROBOTS};" in DOCUMENT
    assert f"has not gone {STILL_M:g} m for {STILL_S:g} s, and another one within {BLOCKED_M:g} m" in DOCUMENT
    assert f"at least {APART_M:g} m from" in DOCUMENT
    assert f"up to {ATTEMPTS} times" in DOCUMENT


@pytest.mark.long
def test_a_document_with_robots_and_people_is_run_and_replayed(tmp_path: Path):
    document: dict[str, Any] = small_document()
    del document["worldExport"], document["deployment"]
    document["simulationBatch"] |= {**BLOCKS[0]["simulationBatch"], "people": 2}
    document["simulationBatch"]["matrix"]["seeds"] = 2
    document["gate"] = {"successRate": {"atLeast": 0.01}}
    store = (tmp_path / "store").as_uri()
    done = finished("run", str(write_document(tmp_path, document)), "--direct", "--store", store)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = tmp_path.glob("store/buckets/results/**/results.parquet")
    rows = pq.read_table(path).to_pylist()
    assert {(row["robots"], row["people"]) for row in rows} == {(3, 2)}
    drove = [row for row in rows if row["status"] == "Completed"]
    assert drove, [row["failure_code"] for row in rows]
    assert all(row["min_robot_m"] is not None and row["min_person_m"] is not None for row in drove)
    number = drove[0]["index"]
    again = finished("replay", f"{rows[0]['batch']}/{number}", "--store", store, "--output", str(tmp_path))
    assert "deviation 0 in all" in again.stdout, again.stdout + again.stderr
    drawing = (tmp_path / "replay.svg").read_text()
    assert 'class="other"' in drawing
    assert 'class="person"' in drawing


@pytest.mark.long
def test_a_document_with_robots_is_run_killed_continued_and_replayed(tmp_path: Path):
    document: dict[str, Any] = small_document()
    del document["worldExport"], document["deployment"]
    document["simulationBatch"] |= BLOCKS[0]["simulationBatch"]
    document["simulationBatch"]["matrix"]["environmentVariables"] = {"MAX_SPEED": ["0.4", "0.6"]}
    document["gate"] = {"successRate": {"atLeast": 0.01}}
    file = str(write_document(tmp_path, document))
    store = (tmp_path / "store").as_uri()
    done = finished("run", file, "--direct", "--store", store)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = tmp_path.glob("store/buckets/results/**/results.parquet")
    rows = pq.read_table(path).to_pylist()
    assert [(row["robots"], row["robot"]) for row in rows] == [(3, number % 3) for number in range(2 * 8 * 2 * 3)]
    assert all(row["min_robot_m"] is not None for row in rows)
    again = finished("replay", f"{rows[0]['batch']}/1", "--store", store, "--output", str(tmp_path))
    assert "deviation 0 in all" in again.stdout, again.stdout + again.stderr
    assert 'class="other"' in (tmp_path / "replay.svg").read_text()

    before, other = path.read_bytes(), tmp_path / "other"
    shutil.copytree(tmp_path / "templates", other / "templates")
    store = (other / "store").as_uri()
    begun = simyard("run", file, "--direct", "--store", store)
    while begun.poll() is None and not [*other.glob("store/chunks/*/*.json")]:
        time.sleep(0.05)
    begun.kill()
    begun.communicate()
    done = finished("run", file, "--direct", "--store", store)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = other.glob("store/buckets/results/**/results.parquet")
    assert path.read_bytes() == before
