"""An export that nobody gave worlds is refused before anything is recorded."""

import pytest

from flows.pipeline.pipeline import world_export
from specs.errors import DocumentError
from specs.pipeline.world_sections import WorldExport
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records


@pytest.mark.parametrize("worlds", [None, []])
def test_all_worlds_of_a_run_that_has_none_are_a_fault_and_no_record(file_store: Store, worlds: list[str] | None):
    section = WorldExport.model_validate({"outputLocation": {"s3Bucket": "worlds"}, "formats": ["mjcf"]})
    with pytest.raises(DocumentError, match=r"worlds: none: <generation>/<world>"):
        world_export(section, worlds, file_store.url)
    assert [*records(file_store, "pipeline-run")] == []
