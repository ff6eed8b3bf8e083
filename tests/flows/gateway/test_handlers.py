"""The lists, records that a stranger changed, and what answering imports."""

import json
import subprocess
import sys
from typing import Any

import pytest

from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from specs.errors import DocumentError
from specs.robomaker.operations import document_shapes
from tasks.simulate.batch.batch_jobs import Jobs
from tasks.simulate.batch.batch_record import close_batch, open_batch
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.factories.planned_batches import begun, mixed, plan, request
from tests.flows.gateway.asked import ROLE, Asked, path
from tests.repository import ROOT

_MOST = {
    "ListDeploymentJobs": 200,
    "ListFleets": 200,
    "ListRobotApplications": 100,
    "ListRobots": 200,
    "ListSimulationApplications": 100,
    "ListSimulationJobBatches": 1000,
    "ListSimulationJobs": 1000,
    "ListWorldExportJobs": 100,
    "ListWorldGenerationJobs": 100,
    "ListWorldTemplates": 100,
    "ListWorlds": 100,
}
STRANGE: dict[str, dict[str, Any]] = {
    "no record": {"kind": None},
    "an ARN that is none": {"arn": "strange"},
    "no request": {"request": {}},
    "a request of texts": {"request": {"request": "x", "plan": "y", "worlds": None}},
}
HEAVY = {"prefect", "jax", "jaxlib", "mujoco", "pyarrow", "numpy", "scipy", "trimesh", "matplotlib", "PIL"}
CODE = """
import json, sys
from flows.gateway.application import Application
from flows.gateway.application import Calls
from tasks.storage.store_url import open_store
from tests.flows.gateway.asked import Asked, asked_for_everything

asked_for_everything(Asked(open_store(sys.argv[1])))
print(json.dumps(sorted(sys.modules)))
"""


def call(store: Store, name: str, **members: object) -> Any:  # noqa: ANN401 - of any shape
    """Returns what an operation answers."""
    asked = document_shapes()[f"{name}Request"].model_validate(members)
    return HANDLERS[name](Gateway(store, lambda: None), asked)


def single(store: Store, token: str) -> str:
    """Returns the id of the batch that a CreateSimulationJob is to Simyard."""
    made = plan(store, seeds=(0,), worlds=("g/w0",))
    entries: Any = request(made)["createSimulationJobRequests"]
    return open_batch(store, made, entries[0], token).id


@pytest.mark.parametrize(("name", "most"), _MOST.items())
def test_a_page_is_as_long_as_the_interface_says(file_store: Store, name: str, most: int) -> None:
    for size in (1, most):
        assert call(file_store, name, maxResults=size).nextToken is None
    for size in (0, -1, -5, most + 1):
        with pytest.raises(DocumentError, match=f"maxResults.*1 to {most}"):
            call(file_store, name, maxResults=size)


@pytest.mark.parametrize("name", _MOST)
@pytest.mark.parametrize("token", ["made-up", "W10=", "bnVsbA==", "WyJyb2JvdCIsdHJ1ZSwiYSJd", "a", "_" * 2048])
def test_a_token_that_no_page_gave_is_refused(file_store: Store, name: str, token: str) -> None:
    with pytest.raises(DocumentError, match="nextToken"):
        call(file_store, name, nextToken=token)


@pytest.mark.parametrize("name", sorted(set(_MOST) - {"ListWorldTemplates"}))
def test_a_filter_that_the_call_does_not_know_is_refused(file_store: Store, name: str) -> None:
    with pytest.raises(DocumentError, match="colour"):
        call(file_store, name, filters=[{"name": "colour", "values": ["red"]}])


def test_a_single_job_is_a_job_from_the_call_on_and_no_batch(file_store: Store) -> None:
    job = single(file_store, "one")
    batch = begun(file_store).id
    (shown,) = call(file_store, "ListSimulationJobs").simulationJobSummaries
    assert shown.name == f"{job}-0"
    (only,) = call(file_store, "ListSimulationJobBatches").simulationJobBatchSummaries
    assert only.arn.endswith(batch)
    close_batch(file_store, job, "Canceled", {})
    for _ in range(2):
        (shown,) = call(file_store, "ListSimulationJobs").simulationJobSummaries
        assert (shown.name, shown.status) == (f"{job}-0", "Canceled")


def test_pages_go_on_in_another_process_whatever_was_made_or_removed(file_store: Store) -> None:
    jobs = [single(file_store, f"t{number}") for number in range(9)]
    for job in jobs[:8]:
        close_batch(file_store, job, "Canceled", {})
    page = call(file_store, "ListSimulationJobs", maxResults=4)
    assert [job.name for job in page.simulationJobSummaries] == [f"{job}-0" for job in jobs[:4]]
    file_store.delete(f"jobs/simulation-job-batch/{jobs[8]}.json")
    later = single(file_store, "later")
    rest = call(open_store(file_store.url), "ListSimulationJobs", nextToken=page.nextToken)
    assert [job.name for job in rest.simulationJobSummaries] == [f"{job}-0" for job in [*jobs[4:8], later]]
    assert rest.nextToken is None


def test_jobs_of_an_ended_batch_are_the_same_from_its_line_as_from_its_chunks(file_store: Store) -> None:
    batch = begun(file_store, plan(file_store, seeds=tuple(range(5))))
    run_chunk(batch, 0, mixed, lanes=4, left_s=3600.0)
    run_chunk(batch, 2, mixed, lanes=4, left_s=3600.0)
    close_batch(file_store, batch.id, "Completed", {})
    live = [each for _, each in Jobs(file_store, batch.id).listed()]
    for size in (1, 3, 100):
        found: list[Any] = []
        token = None
        while True:
            page = call(file_store, "ListSimulationJobs", maxResults=size, nextToken=token)
            found += [job.model_dump(mode="json") for job in page.simulationJobSummaries]
            token = page.nextToken
            if token is None:
                break
        assert found == live


def _change(store: Store, key: str, **members: Any) -> None:  # noqa: ANN401 - what a stranger writes
    store.put(key, json.dumps({**json.loads(store.get(key).body), **members}).encode())


@pytest.mark.parametrize("strange", STRANGE.values(), ids=STRANGE)
def test_a_strange_job_is_left_out_of_lists(asked: Asked, strange: dict[str, Any]):
    export = {"worlds": [asked.world()], "outputLocation": {"s3Bucket": "exports"}, "iamRole": ROLE}
    ours, theirs = (asked.call("CreateWorldExportJob", **export) for _ in range(2))
    _change(asked.store, f"jobs/world-export-job/{path(theirs)}.json", **strange)

    listed = asked.call("ListWorldExportJobs")["worldExportJobSummaries"]

    assert [each["arn"] for each in listed] == [ours["arn"]]


@pytest.mark.parametrize("strange", STRANGE.values(), ids=STRANGE)
def test_a_strange_batch_is_left_out_of_the_lists_of_jobs(asked: Asked, strange: dict[str, Any]):
    request = asked.job_request(asked.world())
    ours, theirs = (asked.call("CreateSimulationJob", **request) for _ in range(2))
    _change(asked.store, f"jobs/simulation-job-batch/{path(theirs).split('/')[0]}.json", **strange)

    listed = [each["arn"] for each in asked.call("ListSimulationJobs")["simulationJobSummaries"]]

    assert ours["arn"] in listed
    assert asked.call("ListSimulationJobBatches")["simulationJobBatchSummaries"] == []


@pytest.mark.parametrize("strange", [{"name": None}, {"name": "another"}], ids=["no record", "of another"])
def test_a_strange_application_is_left_out_of_lists(asked: Asked, strange: dict[str, Any]):
    asked.publish(name="strange")
    _change(asked.store, "applications/robot-application/strange.json", **strange)

    listed = asked.call("ListRobotApplications")["robotApplicationSummaries"]

    assert [each["name"] for each in listed] == ["courier"]


@pytest.mark.parametrize("strange", [{"kind": None}, {"arn": "strange"}, {"status": "Strange"}])
def test_a_fleet_with_a_strange_deployment_is_listed_without_it(asked: Asked, strange: dict[str, Any]):
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    _change(asked.store, f"jobs/deployment-job/{path(made)}.json", **strange)

    (listed,) = asked.call("ListFleets")["fleetDetails"]

    assert listed["name"] == "team"
    assert "lastDeploymentStatus" not in listed


def test_a_strange_template_is_left_out_of_lists(asked: Asked):
    strange = asked.template()
    body = (ROOT / "examples/templates/two-rooms.json").read_text()
    ours = asked.call("CreateWorldTemplate", name="ours", templateBody=body)
    asked.store.put(f"world-templates/{path({'arn': strange})}.json", b"{")

    listed = asked.call("ListWorldTemplates")["templateSummaries"]

    assert ours["arn"] in [each["arn"] for each in listed]


def test_a_fleet_that_names_no_deployment_is_listed(asked: Asked):
    asked.fleet()
    _change(asked.store, "fleets/team.json", deployment="../../else")

    assert [each["name"] for each in asked.call("ListFleets")["fleetDetails"]] == ["team"]


def test_the_calls_about_jobs_need_nothing_that_simulates(asked: Asked):
    ended = subprocess.run(
        [sys.executable, "-c", CODE, asked.store.url], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert sorted(HEAVY.intersection(json.loads(ended.stdout))) == []
