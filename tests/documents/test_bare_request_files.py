"""One of RoboMaker's requests handed to `simyard` as if it were a document."""

import json
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.documents.pipeline_file import read_pipeline
from tests.repository import ROOT

REQUESTS = ROOT / "tests" / "data/samples/requests"


@pytest.mark.parametrize(
    ("request_file", "section"),
    [
        ("create-deployment-job.json", "deployment"),
        ("create-world-generation-job.json", "worldGeneration"),
        ("create-world-export-job.json", "worldExport"),
    ],
)
def test_a_request_alone_is_told_where_it_belongs(request_file: str, section: str):
    with pytest.raises(DocumentError, match=f"below `{section}:`") as refused:
        read_pipeline(REQUESTS / request_file)
    assert len(refused.value.faults) == 1


def test_the_same_request_below_its_section_is_a_document(tmp_path: Path):
    request = json.loads((REQUESTS / "create-world-generation-job.json").read_text())
    (tmp_path / "document.json").write_text(json.dumps({"name": "old", "worldGeneration": request}))
    assert read_pipeline(tmp_path / "document.json").worldGeneration is not None
