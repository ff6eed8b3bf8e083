"""Each error that RoboMaker documents for a call about jobs, as botocore's clients see it."""

from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from botocore import xform_name
from botocore.exceptions import ClientError

from flows.gateway.handlers import _JOB_HANDLERS
from specs.errors import SimyardError, StoreAway, StoreError, StoreThrottled
from specs.robomaker.operations import OPERATIONS, ErrorName
from tests.factories.gateway.robomaker_client import client_of, running_application
from tests.flows.gateway.asked import Asked

pytestmark = pytest.mark.long
NOTHING = "simb-0000000000000000"
STORE_ERRORS: Mapping[ErrorName, type[SimyardError]] = {
    "InternalServer": StoreError,
    "Throttling": StoreThrottled,
    "ServiceUnavailable": StoreAway,
}
QUOTAS = ("GENERATION_JOBS", "EXPORT_JOBS", "BATCHES", "SIMULATION_JOBS", "DEPLOYMENTS")


class Prepared(NamedTuple):
    """A store with everything, requests that a client may send, and what sends them."""

    asked: Asked
    client: Any
    requests: Mapping[str, dict[str, Any]]

    def code(self, operation: str, **changes: Any) -> str:  # noqa: ANN401 - RoboMaker's requests
        """Returns the code that a call is refused with."""
        with pytest.raises(ClientError) as refused:
            getattr(self.client, xform_name(operation))(**{**self.requests[operation], **changes})
        assert self.asked.store.url.removeprefix("file://") not in str(refused.value)
        return refused.value.response["Error"]["Code"]


@pytest.fixture
def prepared(asked: Asked, tmp_path: Path) -> Generator[Prepared]:
    entry, world = asked.job_request(asked.world()), asked.world()
    made = {
        "CreateWorldGenerationJob": {"template": asked.template(), "worldCount": {"floorplanCount": 1}},
        "CreateWorldExportJob": {
            "worlds": [world],
            "outputLocation": {"s3Bucket": "exports"},
            "iamRole": entry["iamRole"],
        },
        "CreateSimulationJob": entry,
        "StartSimulationJobBatch": {"createSimulationJobRequests": [entry]},
        "CreateDeploymentJob": asked.deployment_request(asked.fleet(), "x"),
        "SyncDeploymentJob": {"clientRequestToken": "x", "fleet": asked.arn("deployment-fleet", "team")},
    }
    batch = asked.call("StartSimulationJobBatch", createSimulationJobRequests=[entry])["arn"]
    single = asked.call("CreateSimulationJob", **entry)["arn"]
    known = {name: asked.call(name, **made[name])["arn"] for name in list(made)[:2]}
    named = {
        "WorldGenerationJob": {"job": known["CreateWorldGenerationJob"]},
        "WorldExportJob": {"job": known["CreateWorldExportJob"]},
        "SimulationJob": {"job": single},
        "SimulationJobBatch": {"batch": batch},
        "DeploymentJob": {"job": asked.arn("deployment-job", "dep-0000000000000000")},
    }
    requests = {
        **made,
        **{f"{word}{kind}": request for word in ("Describe", "Cancel") for kind, request in named.items()},
        "RestartSimulationJob": {"job": single},
        "BatchDescribeSimulationJob": {"jobs": [single]},
    }
    with running_application(asked.store) as send:
        yield Prepared(asked, client_of(send, tmp_path / "models", parameter_validation=False), requests)


def cases(*wanted: ErrorName) -> list[Any]:
    """Returns each operation about jobs with each of these errors that it documents."""
    found = [(name, error) for name in sorted(_JOB_HANDLERS) for error in OPERATIONS[name].errors if error in wanted]
    return [pytest.param(*each, id="-".join(each)) for each in found]


@pytest.mark.parametrize(("operation", "error"), cases(*STORE_ERRORS))
def test_what_the_store_cannot_do(
    operation: str, error: ErrorName, prepared: Prepared, monkeypatch: pytest.MonkeyPatch
):
    def get(*_: object, **__: object) -> None:
        raise STORE_ERRORS[error](f"{prepared.asked.store.url}: no")

    monkeypatch.setattr(type(prepared.asked.store), "get", get)
    monkeypatch.setattr(type(prepared.asked.store), "exists", get)
    assert prepared.code(operation) == f"{error}Exception"


def _nowhere(prepared: Prepared, operation: str) -> dict[str, Any]:
    """Returns what an operation is asked of things that are not there."""
    asked, request = prepared.asked, prepared.requests[operation]
    match operation:
        case "CreateSimulationJob":
            return asked.job_request(asked.arn("world", "hand/none"))
        case "CreateWorldGenerationJob":
            return {**request, "template": asked.arn("world-template", "wt-none")}
        case "CreateWorldExportJob":
            return {**request, "worlds": [asked.arn("world", "hand/none")]}
        case "CreateDeploymentJob" | "SyncDeploymentJob":
            return {**request, "fleet": asked.arn("deployment-fleet", "none")}
        case "BatchDescribeSimulationJob":
            return {"jobs": [asked.arn("deployment-fleet", "team")]}
        case _:
            return {key: f"{arn.rpartition(':')[0]}:{_none(arn)}" for key, arn in request.items()}


def _none(arn: str) -> str:
    return f"{NOTHING}/0" if "/" in arn else NOTHING


@pytest.mark.parametrize(("operation", "error"), cases("ResourceNotFound"))
def test_what_is_not_there(operation: str, error: ErrorName, prepared: Prepared):
    assert prepared.code(operation, **_nowhere(prepared, operation)) == f"{error}Exception"


@pytest.mark.parametrize(("operation", "error"), cases("InvalidParameter"))
def test_what_is_no_arn_of_the_kind(operation: str, error: ErrorName, prepared: Prepared):
    request = prepared.requests[operation]
    wrong: dict[str, Any] = dict.fromkeys(("job", "batch", "fleet", "template"), "arn:simyard:robot:x:r1")
    changes = {key: value for key, value in wrong.items() if key in request}
    more = {"worlds": ["no ARN"], "jobs": ["no ARN"], "createSimulationJobRequests": [], "maxJobDurationInSeconds": 0}
    changes |= {key: value for key, value in more.items() if key in request}
    assert prepared.code(operation, **changes) == f"{error}Exception"


@pytest.mark.parametrize(("operation", "error"), cases("IdempotentParameterMismatch"))
def test_a_token_with_another_request(operation: str, error: ErrorName, prepared: Prepared):
    asked, request = prepared.asked, {**prepared.requests[operation], "clientRequestToken": "again"}
    if operation == "SyncDeploymentJob":  # its fleet has never had a deployment that could be synced
        asked.call("CreateDeploymentJob", **asked.deployment_request(request["fleet"], "again"))
        assert prepared.code(operation, **request) == f"{error}Exception"
        return
    asked.call(operation, **request)
    assert prepared.code(operation, **request, tags={"another": "request"}) == f"{error}Exception"


@pytest.mark.parametrize(("operation", "error"), cases("LimitExceeded"))
def test_one_too_many(operation: str, error: ErrorName, prepared: Prepared, monkeypatch: pytest.MonkeyPatch):
    asked = prepared.asked
    for quota in QUOTAS:
        monkeypatch.setenv(f"SIMYARD_MAX_{quota}", "1")
    if operation in {"CreateDeploymentJob", "SyncDeploymentJob"}:
        asked.deployed("team", "earlier")
        asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet("others"), "first"))
    if operation == "RestartSimulationJob":
        monkeypatch.setenv("SIMYARD_MAX_SIMULATION_JOBS", "2")
        asked.call("CreateSimulationJob", **prepared.requests["CreateSimulationJob"])
        monkeypatch.setenv("SIMYARD_MAX_SIMULATION_JOBS", "1")
    assert prepared.code(operation) == f"{error}Exception"


@pytest.mark.parametrize(("operation", "error"), cases("ConcurrentDeployment"))
def test_a_second_deployment(operation: str, error: ErrorName, prepared: Prepared):
    asked = prepared.asked
    asked.call("CreateDeploymentJob", **asked.deployment_request(asked.arn("deployment-fleet", "team"), "first"))
    assert prepared.code(operation) == f"{error}Exception"


def test_an_export_too_many_is_an_invalid_parameter_as_none_fits_better(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_MAX_EXPORT_JOBS", "1")
    assert prepared.code("CreateWorldExportJob") == "InvalidParameterException"


def test_every_documented_error_has_a_test():
    tested = {
        *STORE_ERRORS,
        "ResourceNotFound",
        "InvalidParameter",
        "IdempotentParameterMismatch",
        "LimitExceeded",
        "ConcurrentDeployment",
    }
    assert {error for name in _JOB_HANDLERS for error in OPERATIONS[name].errors} == tested
