"""docs/guide/people.md: what it says of the document is what the document takes."""

import re
from typing import Any

import pytest
import yaml

from specs.data.people import People
from specs.data.result_columns import RESULTS_COLUMNS
from specs.pipeline.gate_section import Gate
from specs.pipeline.simulation_section import SimulationBatch
from tests.docs.typed_blocks import blocks_in
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/people.md").read_text()
BLOCKS: list[dict[str, Any]] = [yaml.safe_load(block) for block in blocks_in(DOCUMENT, "yaml")]
REQUEST = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "courier", "launchConfig": {}}],
    "simulationApplications": [{"application": "delivery", "launchConfig": {}}],
}


@pytest.mark.parametrize("block", [block["simulationBatch"] for block in BLOCKS if "simulationBatch" in block])
def test_a_document_takes_people_as_the_page_writes_them(block: dict[str, Any]):
    section = SimulationBatch.model_validate({**block, "createSimulationJobRequests": [REQUEST]})
    assert section.people == 4 or section.people == People(count=4, speed_ms=1.2, unaware=0.25)


def test_a_gate_takes_the_rule_that_the_page_writes():
    (block,) = (block["gate"] for block in BLOCKS if "gate" in block)
    assert Gate.model_validate(block).quantiles


def test_the_page_names_the_columns_of_people():
    named = re.findall(r"^\| `(\w+)` \|", DOCUMENT, flags=re.MULTILINE)
    columns = [column.name for column in RESULTS_COLUMNS if "person" in column.name or column.name == "people"]
    assert [name for name in named if name in columns] == columns
