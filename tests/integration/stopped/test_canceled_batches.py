"""`simyard cancel` from another process while a batch runs: it stops within seconds and keeps what is done."""

from pathlib import Path

import pytest

from flows.resources.kinds import cancel_resource
from specs.errors import DocumentError
from tasks.simulate.batch.batch_jobs import describe_batch
from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store
from tests.integration.runs import finished, simyard, small_document, tables, write_document
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.timeout(200)]


@pytest.mark.long
def test_a_cancelled_batch_ends_canceled_with_the_rows_of_what_was_done(prefect_server: str, tmp_path: Path):
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = 300  # pyright: ignore[reportIndexIssue]
    store_url = (tmp_path / "store").as_uri()
    run = simyard("run", str(write_document(tmp_path, document)), "--store", store_url)
    assert eventually(lambda: any((tmp_path / "store").glob("chunks/*/000001.started.json")), timeout_s=120.0)
    store = open_store(store_url)
    (batch,) = records(store, "simulation-job-batch")
    cancel_resource(store, batch.arn.replace("simulation-job-batch", "simulation-job", 1) + "/1199")
    assert finished("cancel", batch.arn, "--store", store_url).returncode == 0
    _, err = run.communicate(timeout=60)
    assert (run.returncode, err.splitlines()[-1].startswith("Canceled: canceled on request")) == (3, True), err
    answer = describe_batch(store, batch.id)
    assert answer.status == "Canceled"
    assert {each.failureCode for each in answer.failedRequests or ()} == {"BatchCanceled"}
    statuses = tables(store)["results"].column("status").to_pylist()
    assert (len(statuses), statuses[:16]) == (1200, ["Completed"] * 16)
    assert statuses[-1] == "Canceled"
    with pytest.raises(DocumentError, match="this one is Canceled"):
        cancel_resource(store, batch.arn)
