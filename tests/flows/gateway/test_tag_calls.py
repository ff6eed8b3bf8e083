"""Calls about tags, also many at once."""

from collections.abc import Callable
from threading import Barrier, Thread

import pytest

from specs.errors import DocumentError, LimitExceeded, ResourceAlreadyExists, ResourceNotFound
from specs.template.body import TemplateBody
from tasks.deploy.fleet.fleet_registry import read_robot
from tasks.storage.base.store import Store
from tasks.storage.templates import keep_body, named_templates
from tests.flows.gateway.asked import TEMPLATE, Asked
from tests.flows.gateway.test_world_calls import generation

BORN = {"team": "arms"}
Make = Callable[[Asked], str]
MANY = 6


def a_robot(gateway: Asked) -> str:
    return gateway.call("CreateRobot", name="r", architecture="X86_64", greengrassGroupId="g", tags=BORN)["arn"]


def a_fleet(gateway: Asked) -> str:
    return gateway.call("CreateFleet", name="f", tags=BORN)["arn"]


def a_robot_application(gateway: Asked) -> str:
    return gateway.call("CreateRobotApplication", name="a", robotSoftwareSuite={"name": "ROS2"}, tags=BORN)["arn"]


def a_simulation_application(gateway: Asked) -> str:
    suites = {"robotSoftwareSuite": {"name": "ROS2"}, "simulationSoftwareSuite": {"name": "Gazebo"}}
    return gateway.call("CreateSimulationApplication", name="a", tags=BORN, **suites)["arn"]


def a_template(gateway: Asked) -> str:
    return gateway.call("CreateWorldTemplate", templateBody=TEMPLATE.read_text(), tags=BORN)["arn"]


def a_world(gateway: Asked) -> str:
    return gateway.arn("world", f"{generation(gateway.store, 'w', tags={**BORN}).id}/w")


def a_generation_job(gateway: Asked) -> str:
    template = gateway.template()
    return gateway.call("CreateWorldGenerationJob", template=template, worldCount={"floorplanCount": 1}, tags=BORN)[
        "arn"
    ]


def an_export_job(gateway: Asked) -> str:
    location, role = {"s3Bucket": "exports"}, "arn:aws:iam::123456789012:role/r"
    worlds = [gateway.world()]
    return gateway.call("CreateWorldExportJob", worlds=worlds, outputLocation=location, iamRole=role, tags=BORN)["arn"]


def a_simulation_job(gateway: Asked) -> str:
    gateway.publish()
    return gateway.call("CreateSimulationJob", **gateway.job_request(gateway.world()), tags=BORN)["arn"]


def a_batch(gateway: Asked) -> str:
    gateway.publish()
    requests = [gateway.job_request(gateway.world())]
    return gateway.call("StartSimulationJobBatch", createSimulationJobRequests=requests, tags=BORN)["arn"]


def a_deployment_job(gateway: Asked) -> str:
    gateway.publish()
    return gateway.call("CreateDeploymentJob", **gateway.deployment_request(gateway.fleet()), tags=BORN)["arn"]


MAKES: dict[str, Make] = {
    "DescribeRobot robot": a_robot,
    "DescribeFleet fleet": a_fleet,
    "DescribeRobotApplication application": a_robot_application,
    "DescribeSimulationApplication application": a_simulation_application,
    "DescribeWorldTemplate template": a_template,
    "DescribeWorld world": a_world,
    "DescribeWorldGenerationJob job": a_generation_job,
    "DescribeWorldExportJob job": an_export_job,
    "DescribeSimulationJob job": a_simulation_job,
    "DescribeSimulationJobBatch batch": a_batch,
    "DescribeDeploymentJob job": a_deployment_job,
}


@pytest.mark.parametrize("described", MAKES)
def test_whatever_has_an_arn_is_tagged_and_described_with_its_tags(described: str, gateway: Asked) -> None:
    call, member = described.split()
    resource = MAKES[described](gateway)
    assert gateway.call("ListTagsForResource", resourceArn=resource) == {"tags": BORN}
    gateway.call("TagResource", resourceArn=resource, tags={"team": "legs", "shift": "night"})
    assert gateway.call("ListTagsForResource", resourceArn=resource)["tags"] == {"team": "legs", "shift": "night"}
    assert gateway.call(call, **{member: resource})["tags"] == {"team": "legs", "shift": "night"}
    gateway.call("UntagResource", resourceArn=resource, tagKeys=["team", "never there"])
    assert gateway.call(call, **{member: resource})["tags"] == {"shift": "night"}


@pytest.mark.parametrize(
    ("make", "most"),
    [(a_robot, 50), (a_fleet, 50), (a_robot_application, 50), (a_template, 50), (a_world, 50), (a_simulation_job, 48)],
)
def test_a_tag_too_many_is_refused_and_changes_nothing(make: Make, most: int, gateway: Asked) -> None:
    resource = make(gateway)
    gateway.call("TagResource", resourceArn=resource, tags={f"k{number}": "" for number in range(most - 1)})
    with pytest.raises(DocumentError, match=f"at most {most}"):
        gateway.call("TagResource", resourceArn=resource, tags={"one": "more"})
    assert len(gateway.call("ListTagsForResource", resourceArn=resource)["tags"]) == most


@pytest.mark.parametrize("key", ["aws:x", "AWS:x", "simyard:outcome", ""])
@pytest.mark.parametrize("make", [a_robot, a_world])
def test_reserved_keys_are_refused(key: str, make: Make, gateway: Asked) -> None:
    resource = make(gateway)
    with pytest.raises(DocumentError):
        gateway.call("TagResource", resourceArn=resource, tags={key: "v"})
    with pytest.raises(DocumentError):
        gateway.call("UntagResource", resourceArn=resource, tagKeys=[key])


@pytest.mark.parametrize(
    ("call", "members"),
    [
        ("CreateFleet", {"name": "f"}),
        ("CreateRobotApplication", {"name": "a", "robotSoftwareSuite": {"name": "ROS2"}}),
        ("CreateWorldTemplate", {"templateBody": TEMPLATE.read_text()}),
    ],
)
def test_nothing_is_made_with_a_tag_that_is_simyards_own(call: str, members: dict[str, str], gateway: Asked) -> None:
    with pytest.raises(DocumentError, match="reserved"):
        gateway.call(call, **members, tags={"simyard:outcome": "Passed"})


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ("robot", "none"),
        ("deployment-fleet", "none"),
        ("robot-application", "none"),
        ("world-template", "wt-0123456789abcdef"),
        ("world-template", "0" * 64),
        ("world", "g/w"),
        ("world-generation-job", "wgj-0123456789abcdef"),
        ("world-export-job", "wej-0123456789abcdef"),
        ("simulation-job", "simb-0123456789abcdef/0"),
        ("simulation-job-batch", "simb-0123456789abcdef"),
        ("deployment-job", "dep-0123456789abcdef"),
    ],
)
def test_what_is_not_there_has_no_tags(kind: str, path: str, gateway: Asked) -> None:
    resource = f"arn:simyard:{kind}:s:{path}"
    for call, more in (
        ("ListTagsForResource", {}),
        ("TagResource", {"tags": BORN}),
        ("UntagResource", {"tagKeys": ["k"]}),
    ):
        with pytest.raises(ResourceNotFound):
            gateway.call(call, resourceArn=resource, **more)
    assert gateway.store.keys("tags") == []


def test_a_run_of_a_document_has_no_tags(gateway: Asked) -> None:
    with pytest.raises(DocumentError):
        gateway.call("ListTagsForResource", resourceArn=gateway.arn("pipeline-run", "run-1"))


def test_a_robots_tags_can_be_variables(gateway: Asked) -> None:
    resource = a_robot(gateway)
    with pytest.raises(DocumentError, match="letters, digits and underscores"):
        gateway.call("TagResource", resourceArn=resource, tags={"with space": "v"})
    gateway.call("TagResource", resourceArn=resource, tags={"shift": "night"})
    assert read_robot(gateway.store, "r").tags == {**BORN, "shift": "night"}


def test_a_body_that_documents_used_is_tagged_too(gateway: Asked) -> None:
    digest = keep_body(gateway.store, TemplateBody.model_validate_json(TEMPLATE.read_text()))
    template = gateway.arn("world-template", digest)
    gateway.call("TagResource", resourceArn=template, tags=BORN)
    assert gateway.call("DescribeWorldTemplate", template=template)["tags"] == BORN


def test_an_application_that_comes_with_simyard_is_tagged(gateway: Asked) -> None:
    courier = gateway.arn("robot-application", "courier")
    gateway.call("TagResource", resourceArn=courier, tags=BORN)
    assert gateway.call("DescribeRobotApplication", application=courier)["tags"] == BORN


def at_once(act: Callable[[int], object]) -> None:
    """Does something as often as there are threads, all at the same time."""
    start = Barrier(MANY)

    def one(number: int) -> None:
        start.wait()
        act(number)

    threads = [Thread(target=one, args=(number,)) for number in range(MANY)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()


@pytest.mark.long
@pytest.mark.parametrize("make", [a_robot, a_robot_application, a_template, a_world])
def test_none_of_many_gateways_loses_a_tag(make: Callable[[Asked], str], store: Store) -> None:
    resource = make(Asked(store))
    at_once(lambda number: Asked(store).call("TagResource", resourceArn=resource, tags={f"k{number}": str(number)}))
    found = Asked(store).call("ListTagsForResource", resourceArn=resource)["tags"]
    assert found == {**BORN, **{f"k{number}": str(number) for number in range(MANY)}}


@pytest.mark.long
def test_of_many_templates_of_one_name_one_is_made(store: Store) -> None:
    made: list[str] = []

    def create(_: int) -> None:
        try:
            made.append(Asked(store).call("CreateWorldTemplate", name="flat", templateBody=TEMPLATE.read_text())["arn"])
        except ResourceAlreadyExists:
            return

    at_once(create)
    assert [Asked(store).arn("world-template", each.id) for each in named_templates(store)] == made
    assert len(made) == 1


@pytest.mark.long
def test_one_gateway_never_exceeds_a_quota(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_FLEETS", "2")
    refused: list[int] = []

    def create(number: int) -> None:
        try:
            Asked(store).call("CreateFleet", name=f"f{number}")
        except LimitExceeded:
            refused.append(number)

    at_once(create)
    assert len(refused) == MANY - 2
    assert len(store.keys("fleets")) == 2
