"""docs/guide/boxes.md: what it says of the document is what the document takes."""

import re
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import yaml

from specs.data.boxes import MOST_BOXES, Box
from specs.pipeline.simulation_section import SimulationBatch
from tests.docs.typed_blocks import blocks_in
from tests.integration.runs import finished, small_document, write_document
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/boxes.md").read_text()
(BLOCK,) = (yaml.safe_load(block)["simulationBatch"] for block in blocks_in(DOCUMENT, "yaml"))
REQUEST = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "courier", "launchConfig": {}}],
    "simulationApplications": [{"application": "delivery", "launchConfig": {}}],
}


def test_a_document_takes_boxes_as_the_page_writes_them():
    section = SimulationBatch.model_validate({**BLOCK, "createSimulationJobRequests": [REQUEST]})
    assert section.boxes == (
        Box(size_m=(0.4, 0.4, 0.6), appears_s=5.0, leaves_s=20.0),
        Box(size_m=(0.3, 1.2, 1.0), at_m=(2.0, 1.5)),
    )


def test_the_page_names_the_fields_of_a_box_and_how_many_there_are():
    assert re.findall(r"^\| `(\w+)` \|", DOCUMENT, flags=re.MULTILINE) == list(Box.model_fields)
    assert f"There are up to {MOST_BOXES}." in DOCUMENT


@pytest.mark.long
def test_a_document_with_boxes_is_run_audited_and_replayed(tmp_path: Path):
    document: dict[str, Any] = small_document()
    del document["worldExport"], document["deployment"]
    document["simulationBatch"] |= {**BLOCK, "audit": {"lanes": 4}}
    document["gate"] = {"successRate": {"atLeast": 0.01}}
    store = (tmp_path / "store").as_uri()
    done = finished("run", str(write_document(tmp_path, document)), "--direct", "--store", store)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "SOUND" in done.stdout
    (path,) = tmp_path.glob("store/buckets/results/**/results.parquet")
    assert {row["boxes"] for row in pq.read_table(path).to_pylist()} == {2}
    batch = re.findall(r"arn:simyard:simulation-job-batch:(\S+)", done.stdout)[0]
    again = finished("replay", f"arn:simyard:simulation-job:{batch}/0", "--store", store, "--output", str(tmp_path))
    assert "deviation 0 in all" in again.stdout, again.stdout + again.stderr
    assert 'class="box"' in (tmp_path / "replay.svg").read_text()
