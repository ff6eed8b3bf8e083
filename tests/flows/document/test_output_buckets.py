"""A bucket that a run would make in a folder is named, so that a misspelt one is seen."""

import pytest

from flows.pipeline.references import new_bucket_lines
from specs.pipeline.document import PipelineSpec
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket


def _spec(batch: str, export: str) -> PipelineSpec:
    return PipelineSpec.model_validate(
        {
            "name": "n",
            "worldExport": {"worlds": ["g/w"], "outputLocation": {"s3Bucket": export}},
            "simulationBatch": {
                "matrix": {"worlds": ["g/w"]},
                "outputLocation": {"s3Bucket": batch},
                "createSimulationJobRequests": [{"maxJobDurationInSeconds": 60}],
            },
        }
    )


def test_a_bucket_that_is_not_there_is_named_once_with_those_that_are(file_store: Store):
    for name in ("results", "worlds"):
        open_bucket(file_store, name).put("a", b"")

    (line,) = new_bucket_lines(_spec("reslts", "reslts"), file_store)

    folder = f"{file_store.url.removeprefix('file://')}/buckets/reslts"
    assert line == f"bucket reslts is new, and is made in {folder}; there are results, worlds"
    assert not open_bucket(file_store, "reslts").keys("")


def test_the_first_bucket_of_a_store_is_new_and_one_that_is_there_is_not(file_store: Store):
    (line,) = new_bucket_lines(_spec("results", "results"), file_store)
    assert line.endswith("/buckets/results")
    open_bucket(file_store, "results").put("a", b"")
    assert [*new_bucket_lines(_spec("results", "results"), file_store)] == []


def test_of_a_server_nothing_is_said_because_it_refuses_what_it_does_not_have(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_BUCKETS", "s3://")
    assert [*new_bucket_lines(_spec("results", "results"), file_store)] == []
