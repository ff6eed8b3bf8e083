"""docs/guide/people.md: what it says of the document is what the document takes."""

import re
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import yaml

from specs.data.people import People
from specs.data.result_columns import RESULTS_COLUMNS
from specs.pipeline.gate_section import Gate
from specs.pipeline.simulation_section import SimulationBatch
from tests.docs.typed_blocks import blocks_in
from tests.integration.runs import finished, small_document, write_document
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/people.md").read_text()
BLOCKS: list[dict[str, Any]] = [yaml.safe_load(block) for block in blocks_in(DOCUMENT, "yaml")]
(VARIED,) = (batch for block in BLOCKS if "matrix" in (batch := block.get("simulationBatch", {})))
REQUEST = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "courier", "launchConfig": {}}],
    "simulationApplications": [{"application": "delivery", "launchConfig": {}}],
}


@pytest.mark.parametrize("block", [block["simulationBatch"] for block in BLOCKS if "simulationBatch" in block])
def test_a_document_takes_people_as_the_page_writes_them(block: dict[str, Any]):
    section = SimulationBatch.model_validate({**block, "createSimulationJobRequests": [REQUEST]})
    assert section.people == 4 or section.people == People(count=4, speed_ms=1.2, unaware=0.25)


@pytest.mark.long
def test_a_document_with_people_is_run_and_replayed(tmp_path: Path):
    document: dict[str, Any] = small_document()
    del document["worldExport"], document["deployment"]
    document["simulationBatch"] |= BLOCKS[0]["simulationBatch"]
    document["simulationBatch"]["matrix"] |= VARIED["matrix"]
    document["gate"] = {"successRate": {"atLeast": 0.1}}
    store = (tmp_path / "store").as_uri()
    done = finished("run", str(write_document(tmp_path, document)), "--direct", "--store", store)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = tmp_path.glob("store/buckets/results/**/results.parquet")
    rows = pq.read_table(path).to_pylist()
    counts = VARIED["matrix"]["physics"]["people.count"]
    assert {(row["people"], dict(row["environment"])["people.count"]) for row in rows} == {(k, str(k)) for k in counts}
    page = path.with_name("report.html").read_text()
    assert "By people.count" in page
    assert f"{counts[0]} or {counts[1]} in each world" in page
    assert all((row["min_person_m"] < 1.2) == (row["person_personal_s"] > 0.0) for row in rows)
    assert len({row["min_person_m"] for row in rows}) > len(rows) // 2
    batch = re.findall(r"arn:simyard:simulation-job-batch:(\S+)", done.stdout)[0]
    again = finished("replay", f"arn:simyard:simulation-job:{batch}/0", "--store", store, "--output", str(tmp_path))
    assert "deviation 0 in all" in again.stdout, again.stdout + again.stderr
    assert (tmp_path / "replay.svg").is_file()


def test_a_gate_takes_the_rule_that_the_page_writes():
    (block,) = (block["gate"] for block in BLOCKS if "gate" in block)
    assert Gate.model_validate(block).quantiles


def test_the_page_names_the_columns_of_people():
    named = re.findall(r"^\| `(\w+)` \|", DOCUMENT, flags=re.MULTILINE)
    columns = [column.name for column in RESULTS_COLUMNS if "person" in column.name or column.name == "people"]
    assert [name for name in named if name in columns] == columns
