"""The documents that docs/guide/applications.md names: they ask for the shipped applications, and for those figures."""

import re

import pytest

from flows.pipeline.references import resolve_references
from tasks.documents.pipeline_file import read_pipeline
from tasks.storage.store_url import open_store
from tests.factories.simulations import REPOSITORY

NAMED = re.findall(r"\]\((?:\.\./)+(examples/\S+\.yaml)\)", (REPOSITORY / "docs/guide" / "applications.md").read_text())


def test_the_document_names_them():
    assert sorted(set(NAMED)) == ["examples/applications.yaml", "examples/noise.yaml"]


@pytest.mark.parametrize("path", sorted(set(NAMED)))
def test_what_they_refer_to_ships(path: str, tmp_path_factory: pytest.TempPathFactory):
    spec = read_pipeline(REPOSITORY / path)
    store = open_store(tmp_path_factory.mktemp("store").as_uri())
    resolve_references(spec, store, REPOSITORY / "examples")
    assert spec.simulationBatch is not None
    assert len(list(spec.simulationBatch.createSimulationJobRequests)) in {1, 5}
