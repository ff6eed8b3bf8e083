"""A flow run of a whole document that a person has retried on Prefect's page after its end."""

import os

import pytest
from prefect.client.orchestration import get_client
from prefect.flow_engine import run_flow
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings
from prefect.states import AwaitingRetry

from flows.prefect.flows import pipeline
from specs.pipeline.document import PipelineSpec
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records
from tasks.storage.jobs.runs import run_of

SPEC = PipelineSpec.model_validate(
    {
        "name": "retried",
        "worldGeneration": {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 1},
    }
)


@pytest.mark.integration
@pytest.mark.long
def test_an_ended_flow_run_that_is_retried_does_the_work_of_the_next_run(prefect_server: str, file_store: Store):
    parameters = {"spec": SPEC, "store": file_store.url, "base": "examples"}
    password = os.environ["PREFECT_API_AUTH_STRING"]
    with temporary_settings({PREFECT_API_URL: prefect_server, PREFECT_API_AUTH_STRING: password}):
        first = pipeline(SPEC, store=file_store.url, base="examples", return_state=True)
        with get_client(sync_client=True) as client:
            flow_run = first.state_details.flow_run_id
            assert flow_run
            client.set_flow_run_state(flow_run, AwaitingRetry(), force=True)
            run_flow(pipeline, flow_run=client.read_flow_run(flow_run), parameters=parameters)
    runs = {run.id for run in records(file_store, "pipeline-run")}
    assert {run_of(job.token) for job in records(file_store, "world-generation-job")} == runs
    assert len(runs) == 2
