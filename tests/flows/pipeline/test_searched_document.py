"""A document that searches its batch: the stage, the gate that asks for it, the report, and a replay of a failure."""

import json
from pathlib import Path

import pytest

from flows.batch.search_batch import replay_found
from tasks.results.statistics.found_failures import read_search
from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store
from tests.integration.runs import finished
from tests.integration.searched_document import searched_document


@pytest.mark.long
def test_a_document_says_how_rare_failures_are_and_its_gate_judges_that(tmp_path: Path):
    store = open_store((tmp_path / "store").as_uri())
    document = searched_document(tmp_path / "document")
    planned = finished("plan", str(document), "--store", store.url).stdout
    assert "search            up to 1,000 episodes beside the batch's 32, over MAX_SPEED, worlds and seeds" in planned
    assert "the search's 1,000 are ENOUGH" in planned
    ended = finished("run", str(document), "--direct", "--json", "--store", store.url)
    assert ended.returncode == 0, ended.stderr
    report = json.loads(ended.stdout)
    assert [stage["name"] for stage in report["stages"]] == ["worldGeneration", "simulationBatch", "search", "gate"]
    (batch,) = records(store, "simulation-job-batch")
    found = read_search(store, batch.id)
    assert found
    assert found.probability.episodes <= 1_000
    assert report["stages"][2]["facts"]["probability"] == json.loads(found.probability.model_dump_json())
    assert found.probability.sentence in report["stages"][3]["summary"]
    page = store.get(str(batch.detail["report_url"]).removeprefix(f"{store.url}/")).body.decode()
    assert f"simyard replay {batch.arn} --found 1" in page
    again = finished("gate", batch.arn, "--document", str(document), "--store", store.url)
    assert again.returncode == 0, again.stdout + again.stderr
    assert replay_found(store, batch.id, 1).same
