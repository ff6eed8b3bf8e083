"""Each error that RoboMaker documents for an operation, as it is answered over HTTP."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from botocore.exceptions import ClientError

from flows.gateway.handlers import HANDLERS
from specs.errors import SimyardError, StoreAway, StoreError, StoreThrottled
from specs.robomaker.operations import OPERATIONS, ErrorName
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.factories.gateway.robomaker_client import Send, client_of, request_of, running_application
from tests.flows.gateway.asked import TEMPLATE, Asked, path, with_applications

NOTHING = "simb-0000000000000000"
STORE_ERRORS: Mapping[ErrorName, type[SimyardError]] = {
    "InternalServer": StoreError,
    "Throttling": StoreThrottled,
    "ServiceUnavailable": StoreAway,
}
QUOTAS = (
    *("GENERATION_JOBS", "EXPORT_JOBS", "BATCHES", "SIMULATION_JOBS", "DEPLOYMENTS"),
    *("FLEETS", "ROBOTS", "FLEET_ROBOTS", "APPLICATIONS", "TEMPLATES"),
)
SUITES = {"robotSoftwareSuite": {"name": "ROS2"}, "simulationSoftwareSuite": {"name": "Gazebo"}}
ROBOT_SUITE = {"robotSoftwareSuite": {"name": "ROS2"}}
_LISTS = {name for name in HANDLERS if name.startswith("List") and name != "ListTagsForResource"}
_VERSIONS = ("CreateRobotApplicationVersion", "CreateSimulationApplicationVersion")
# What cannot happen here: lists filter instead of looking up, applications have no token and no limit on updates. That
# a 41st version is refused is in test_application_calls.py.
NEVER = {
    *((name, "ResourceNotFound") for name in _LISTS),
    *((f"Create{kind}Application", "IdempotentParameterMismatch") for kind in ("Robot", "Simulation")),
    *((f"Update{kind}Application", "LimitExceeded") for kind in ("Robot", "Simulation")),
    *((name, error) for name in _VERSIONS for error in ("IdempotentParameterMismatch", "LimitExceeded")),
}


class Prepared(NamedTuple):
    """A store with everything, requests that a client may send, and what sends them."""

    asked: Asked
    send: Send
    requests: Mapping[str, dict[str, Any]]

    def code(self, operation: str, **changes: Any) -> str:  # noqa: ANN401 - RoboMaker's requests
        """Returns the code that a call is refused with."""
        answer = self.send(*request_of(OPERATIONS[operation], {**self.requests[operation], **changes}))
        assert answer.status >= 400
        assert self.asked.store.url.removeprefix("file://") not in answer.body.decode()
        return answer.error.removesuffix("Exception")


@contextmanager
def _prepared(store: Store) -> Generator[Prepared]:
    asked = with_applications(store)
    requests = {**_of_jobs(asked), **_of_resources(asked), **{name: {} for name in _LISTS}}
    with running_application(asked.store) as send:
        yield Prepared(asked, send, requests)


@pytest.fixture
def prepared(file_store: Store) -> Generator[Prepared]:
    """A store of the test's own."""
    with _prepared(file_store) as made:
        yield made


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Generator[Prepared]:
    """One store for all calls that change nothing."""
    with _prepared(open_store((tmp_path_factory.mktemp("shared") / "store").as_uri())) as made:
        yield made


def _of_jobs(asked: Asked) -> dict[str, dict[str, Any]]:
    entry, world = asked.job_request(asked.world()), asked.world()
    export = {"worlds": [world], "outputLocation": {"s3Bucket": "exports"}, "iamRole": entry["iamRole"]}
    made = {
        "CreateWorldGenerationJob": {"template": asked.template(), "worldCount": {"floorplanCount": 1}},
        "CreateWorldExportJob": export,
        "CreateSimulationJob": entry,
        "StartSimulationJobBatch": {"createSimulationJobRequests": [entry]},
        "CreateDeploymentJob": asked.deployment_request(asked.fleet(), "x"),
        "SyncDeploymentJob": {"clientRequestToken": "x", "fleet": asked.arn("deployment-fleet", "team")},
    }
    single = asked.call("CreateSimulationJob", **entry)["arn"]
    named = {
        "SimulationJobBatch": {
            "batch": asked.call("StartSimulationJobBatch", **made["StartSimulationJobBatch"])["arn"]
        },
        "SimulationJob": {"job": single},
        **{
            kind: {"job": asked.call(f"Create{kind}", **made[f"Create{kind}"])["arn"]}
            for kind in ("WorldGenerationJob", "WorldExportJob")
        },
        "DeploymentJob": {"job": asked.arn("deployment-job", "dep-0000000000000000")},
    }
    return {
        **made,
        **{f"{word}{kind}": request for word in ("Describe", "Cancel") for kind, request in named.items()},
        "RestartSimulationJob": {"job": single},
        "BatchDescribeSimulationJob": {"jobs": [single]},
    }


def _of_resources(asked: Asked) -> dict[str, dict[str, Any]]:
    fleet, robot = asked.arn("deployment-fleet", "team"), asked.arn("robot", "team-0")
    template = asked.call("CreateWorldTemplate", name="taken", templateBody=TEMPLATE.read_text())["arn"]
    applications = {
        "Robot": ({"application": asked.arn("robot-application", "courier")}, ROBOT_SUITE),
        "Simulation": ({"application": asked.arn("simulation-application", "delivery")}, SUITES),
    }
    of_applications: dict[str, dict[str, Any]] = {}
    for kind, (named, suites) in applications.items():
        of_applications |= {
            f"Create{kind}Application": {"name": "new", **suites},
            f"Update{kind}Application": {**named, **suites},
            **{f"{word}{kind}Application": named for word in ("Describe", "Delete")},
            f"Create{kind}ApplicationVersion": named,
        }
    asked.call("CreateRobot", name="free", architecture="ARM64", greengrassGroupId="g")
    return {
        **of_applications,
        "CreateFleet": {"name": "new"},
        "CreateRobot": {"name": "new", "architecture": "ARM64", "greengrassGroupId": "g"},
        "RegisterRobot": {"fleet": fleet, "robot": asked.arn("robot", "free")},
        "DeregisterRobot": {"fleet": fleet, "robot": robot},
        **{f"{word}Fleet": {"fleet": fleet} for word in ("Describe", "Delete")},
        **{f"{word}Robot": {"robot": robot} for word in ("Describe", "Delete")},
        "CreateWorldTemplate": {"templateBody": TEMPLATE.read_text()},
        "UpdateWorldTemplate": {"template": template, "name": "newer"},
        "DescribeWorldTemplate": {"template": template},
        "GetWorldTemplateBody": {"template": template},
        "DeleteWorldTemplate": {"template": template},
        "DescribeWorld": {"world": asked.world()},
        "BatchDeleteWorlds": {"worlds": [asked.world()]},
        "TagResource": {"resourceArn": fleet, "tags": {"a": "b"}},
        "UntagResource": {"resourceArn": fleet, "tagKeys": ["a"]},
        "ListTagsForResource": {"resourceArn": fleet},
    }


def cases(*wanted: ErrorName) -> list[Any]:
    """Returns each operation with each of these errors that it documents and that can happen."""
    found = [(name, error) for name in sorted(HANDLERS) for error in OPERATIONS[name].errors if error in wanted]
    return [pytest.param(*each, id="-".join(each)) for each in found if each not in NEVER]


@pytest.mark.parametrize(("operation", "error"), cases(*STORE_ERRORS))
def test_what_the_store_cannot_do(operation: str, error: ErrorName, shared: Prepared, monkeypatch: pytest.MonkeyPatch):
    def fails(*_: object, **__: object) -> None:
        raise STORE_ERRORS[error](f"{shared.asked.store.url}: no")

    for method in ("get", "exists", "keys", "put", "create", "replace", "delete"):
        monkeypatch.setattr(type(shared.asked.store), method, fails)
    assert shared.code(operation) == error


@pytest.mark.parametrize(("operation", "error"), cases("ResourceNotFound"))
def test_what_is_not_there(operation: str, error: ErrorName, shared: Prepared):
    asked, request = shared.asked, shared.requests[operation]
    special = {
        "CreateSimulationJob": asked.job_request(asked.arn("world", "hand/none")),
        "CreateWorldExportJob": {"worlds": [asked.arn("world", "hand/none")]},
        "CreateWorldTemplate": {"templateBody": None, "templateLocation": {"s3Bucket": "nowhere", "s3Key": "k"}},
        "BatchDescribeSimulationJob": {"jobs": [asked.arn("deployment-fleet", "team")]},
        "DescribeWorld": {"world": asked.arn("world", "hand/none")},
    }
    named = {key: arn for key, arn in request.items() if str(arn).startswith("arn:") and key != "iamRole"}
    nowhere = {key: _none(arn) for key, arn in named.items()}
    assert shared.code(operation, **special.get(operation, nowhere)) == error


def _none(arn: str) -> str:
    return f"{arn.rpartition(':')[0]}:{f'{NOTHING}/0' if '/' in arn else NOTHING}"


@pytest.mark.parametrize(("operation", "error"), cases("InvalidParameter"))
def test_what_is_no_parameter(operation: str, error: ErrorName, shared: Prepared):
    wrong: dict[str, Any] = {
        **dict.fromkeys(("job", "batch", "fleet", "template", "application"), "arn:simyard:robot:x:r1"),
        **dict.fromkeys(("robot", "world", "resourceArn"), "arn:simyard:pipeline-run:x:r1"),
        "jobs": ["no ARN"],
        "createSimulationJobRequests": [],
        "maxJobDurationInSeconds": 0,
        "name": "no name!",
        "templateBody": "{",
        "worlds": [],
    }
    changes = {key: value for key, value in wrong.items() if key in shared.requests[operation]}
    assert shared.code(operation, **(changes or {"maxResults": 0})) == error


@pytest.mark.parametrize(("operation", "error"), cases("IdempotentParameterMismatch"))
def test_a_token_with_another_request(operation: str, error: ErrorName, prepared: Prepared):
    asked, request = prepared.asked, {**prepared.requests[operation], "clientRequestToken": "again"}
    if operation == "SyncDeploymentJob":  # its fleet has never had a deployment that could be synced
        asked.call("CreateDeploymentJob", **asked.deployment_request(request["fleet"], "again"))
        assert prepared.code(operation, **request) == error
        return
    asked.call(operation, **request)
    assert prepared.code(operation, **request, tags={"another": "request"}) == error


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
    assert prepared.code(operation) == error


@pytest.mark.parametrize(("operation", "error"), cases("ResourceAlreadyExists"))
def test_a_name_that_is_taken(operation: str, error: ErrorName, prepared: Prepared):
    taken = {"CreateRobot": "free", "CreateRobotApplication": "courier", "CreateWorldTemplate": "taken"}
    assert prepared.code(operation, name=taken.get(operation, "delivery")) == error


@pytest.mark.parametrize(("operation", "error"), cases("ConcurrentDeployment"))
def test_a_second_deployment(operation: str, error: ErrorName, prepared: Prepared):
    asked = prepared.asked
    asked.call("CreateDeploymentJob", **asked.deployment_request(asked.arn("deployment-fleet", "team"), "first"))
    assert prepared.code(operation) == error


def test_an_export_too_many_is_an_invalid_parameter_as_none_fits_better(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_MAX_EXPORT_JOBS", "1")
    assert prepared.code("CreateWorldExportJob") == "InvalidParameter"


def test_an_sdk_raises_the_error_by_its_name(prepared: Prepared, tmp_path: Path):
    client = client_of(prepared.send, tmp_path / "models")
    made = client.create_fleet(name="sdk", tags={"site": "north"})
    assert client.describe_fleet(fleet=made["arn"])["tags"] == {"site": "north"}
    with pytest.raises(ClientError) as refused:
        client.describe_fleet(fleet=made["arn"].replace(path(made), "none"))
    assert refused.value.response["Error"]["Code"] == "ResourceNotFoundException"


def test_every_documented_error_has_a_test():
    tested = {
        *STORE_ERRORS,
        *("ResourceNotFound", "InvalidParameter", "IdempotentParameterMismatch", "LimitExceeded"),
        *("ConcurrentDeployment", "ResourceAlreadyExists"),
    }
    assert {error for name in HANDLERS for error in OPERATIONS[name].errors} == tested
    assert HANDLERS.keys() == OPERATIONS.keys()
