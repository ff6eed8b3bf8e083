"""What a key may do, for all 57 operations: by its rights, and by what it is limited to."""

import json
from typing import Any

import pytest

from specs.arn import KINDS, ResourceKind
from specs.errors import AccessRefused
from specs.robomaker.operations import OPERATIONS, document_shapes
from tasks.gateway.access.access_keys import RIGHTS, new_key
from tasks.gateway.access.rights import WHOLE, check_right, request_arns, right_for

STORE = "0123456789abcdef"
FLEETS = {("robot", "r-home"): "home", ("robot", "r-other"): "other"} | {
    ("deployment-job", f"deployment-{name}"): name for name in ("home", "other")
}


def fleet_of(kind: ResourceKind, path: str) -> str:
    return FLEETS.get((kind, path), "")


def arn(kind: str, path: str) -> str:
    return f"arn:simyard:{kind}:{STORE}:{path}"


def refusal(operation: str, document: dict[str, Any], rights: list[str], *on: str) -> str:
    asked = OPERATIONS[operation]
    shape = document_shapes()[asked.request].model_construct(**document)
    try:
        check_right(new_key("ci", rights, on), asked, shape, STORE, fleet_of)
    except AccessRefused as exc:
        return f"{exc.status} {exc.code}: {exc}"
    return ""


def deployment(fleet: str, application: str = "nav") -> dict[str, Any]:
    return {
        "fleet": arn("deployment-fleet", fleet),
        "clientRequestToken": "t",
        "deploymentApplicationConfigs": (
            document_shapes()["DeploymentApplicationConfig"].model_construct(
                application=arn("robot-application", application), applicationVersion="1"
            ),
        ),
    }


@pytest.mark.parametrize("operation", [name for name, each in OPERATIONS.items() if each.right != "tag"])
def test_an_operation_needs_its_own_right_and_no_other(operation: str) -> None:
    needed = OPERATIONS[operation].right
    others = [right for right in RIGHTS if right != needed]
    assert not refusal(operation, {}, [needed])
    refused = refusal(operation, {}, others)
    assert refused.startswith("403 AccessDeniedException")
    assert f"lacks the right {needed}" in refused


def test_nothing_that_is_only_read_needs_another_right() -> None:
    for name, operation in OPERATIONS.items():
        assert (operation.right == "read") is name.startswith(("Describe", "List", "Get", "BatchDescribe"))


@pytest.mark.parametrize("operation", ["TagResource", "UntagResource"])
@pytest.mark.parametrize("kind", KINDS)
def test_tags_need_the_right_of_what_is_tagged(operation: str, kind: str) -> None:
    document = document_shapes()[f"{operation}Request"].model_construct(resourceArn=arn(kind, "x"))
    of_fleets = kind in {"deployment-fleet", "robot", "deployment-job"}
    assert right_for(OPERATIONS[operation], document) == ("deploy" if of_fleets else "simulate")


REACHING = [
    ("DeleteFleet", {"fleet": arn("deployment-fleet", "other")}),
    ("DescribeFleet", {"fleet": arn("deployment-fleet", "other")}),
    ("SyncDeploymentJob", {"fleet": arn("deployment-fleet", "other"), "clientRequestToken": "t"}),
    ("CreateDeploymentJob", deployment("other")),
    ("CancelDeploymentJob", {"job": arn("deployment-job", "deployment-other")}),
    ("DescribeDeploymentJob", {"job": arn("deployment-job", "deployment-other")}),
    ("CancelDeploymentJob", {"job": arn("deployment-job", "deployment-nobody")}),
    ("RegisterRobot", {"fleet": arn("deployment-fleet", "other"), "robot": arn("robot", "r-free")}),
    ("RegisterRobot", {"fleet": arn("deployment-fleet", "home"), "robot": arn("robot", "r-other")}),
    ("DeregisterRobot", {"fleet": arn("deployment-fleet", "other"), "robot": arn("robot", "r-other")}),
    ("DeregisterRobot", {"fleet": arn("deployment-fleet", "home"), "robot": arn("robot", "r-other")}),
    ("DeleteRobot", {"robot": arn("robot", "r-other")}),
    ("DescribeRobot", {"robot": arn("robot", "r-other")}),
    ("CreateFleet", {"name": "other"}),
    ("CreateFleet", {"name": "home-2"}),
    ("TagResource", {"resourceArn": arn("deployment-fleet", "other"), "tags": {"a": "b"}}),
    ("TagResource", {"resourceArn": arn("robot", "r-other"), "tags": {"a": "b"}}),
    ("TagResource", {"resourceArn": arn("deployment-job", "deployment-other"), "tags": {"a": "b"}}),
    ("UntagResource", {"resourceArn": arn("deployment-fleet", "other"), "tagKeys": ("a",)}),
    ("ListTagsForResource", {"resourceArn": arn("deployment-fleet", "other")}),
    ("ListFleets", {}),
    ("ListDeploymentJobs", {}),
    ("ListRobots", {}),
]


@pytest.mark.parametrize(("operation", "document"), REACHING)
def test_a_key_of_one_fleet_reaches_no_other(operation: str, document: dict[str, Any]) -> None:
    limits = ("deployment-fleet/home", "robot/*", "robot-application/*", "deployment-job/*")
    assert refusal(operation, document, [*RIGHTS], *limits)
    assert not refusal(operation, document, [*RIGHTS])


def test_the_calls_that_reach_a_fleet_are_all_tried() -> None:
    fields = {"fleet", "robot", "resourceArn"}
    reaching = {
        name for name, each in OPERATIONS.items() if fields & document_shapes()[each.request].model_fields.keys()
    }
    deploying = {name for name, each in OPERATIONS.items() if each.right == "deploy"} - {"CreateRobot"}
    assert reaching | deploying <= {name for name, _ in REACHING}


@pytest.mark.parametrize(
    ("operation", "document"),
    [
        ("DeleteFleet", {"fleet": arn("deployment-fleet", "home")}),
        ("DeleteFleet", {"fleet": "arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/home/1600000000000"}),
        ("CreateDeploymentJob", deployment("home")),
        ("CancelDeploymentJob", {"job": arn("deployment-job", "deployment-home")}),
        ("RegisterRobot", {"fleet": arn("deployment-fleet", "home"), "robot": arn("robot", "r-free")}),
        ("DeregisterRobot", {"fleet": arn("deployment-fleet", "home"), "robot": arn("robot", "r-home")}),
        ("DeleteRobot", {"robot": arn("robot", "r-home")}),
        ("CreateFleet", {"name": "home"}),
        ("CreateRobot", {"name": "r-new"}),
        ("TagResource", {"resourceArn": arn("robot", "r-home"), "tags": {"a": "b"}}),
    ],
)
def test_a_key_of_one_fleet_does_all_with_it(operation: str, document: dict[str, Any]) -> None:
    limits = ("deployment-fleet/home", "robot/r-free", "robot/r-new", "robot-application/nav")
    assert not refusal(operation, document, ["deploy"], *limits)


def test_every_arn_of_a_request_is_looked_at() -> None:
    limits = ("deployment-fleet/home", "robot-application/nav")
    assert "secret" in refusal("CreateDeploymentJob", deployment("home", "secret"), ["deploy"], *limits)
    jobs = {"jobs": (arn("simulation-job", "simb-a/0"), arn("simulation-job", "simb-b/0"))}
    assert "simb-b" in refusal("BatchDescribeSimulationJob", jobs, ["read"], "simulation-job/simb-a/*")


def test_a_refusal_says_which_limit_would_let_the_call_in() -> None:
    refused = refusal("CreateDeploymentJob", deployment("home"), ["deploy"], "deployment-fleet/home")
    missing = refused.rpartition("do not cover ")[2].strip("'")
    assert missing == "robot-application/nav"
    assert not refusal("CreateDeploymentJob", deployment("home"), ["deploy"], "deployment-fleet/home", missing)


def test_an_arn_of_no_kind_is_covered_by_nothing() -> None:
    assert refusal("DeleteRobot", {"robot": "arn:nonsense"}, ["deploy"], *(f"{kind}/*" for kind in KINDS))


@pytest.mark.parametrize(("operation", "kinds"), WHOLE.items())
def test_lists_and_what_has_no_name_yet_need_the_whole_kind(operation: str, kinds: tuple[str, ...]) -> None:
    assert refusal(operation, {}, [*RIGHTS], *(f"{kind}/a*" for kind in kinds))
    assert not refusal(operation, {}, [*RIGHTS], *(f"{kind}/*" for kind in kinds))


def test_every_list_and_every_job_is_thought_of() -> None:
    lists = {name for name, each in OPERATIONS.items() if each.pages}
    started = {name for name, each in OPERATIONS.items() if each.idempotent} - {
        "CreateDeploymentJob",
        "SyncDeploymentJob",
    }
    assert WHOLE.keys() == lists | started


def test_every_request_without_an_arn_says_a_name_or_needs_a_whole_kind() -> None:
    # Whatever is neither could be called by a limited key about anything.
    bare = {
        name
        for name, each in OPERATIONS.items()
        if '"^(?:arn:.*)$"' not in json.dumps(document_shapes()[each.request].model_json_schema())
    }
    assert bare - WHOLE.keys() == {
        "CreateFleet",
        "CreateRobot",
        "CreateRobotApplication",
        "CreateSimulationApplication",
        "CreateWorldTemplate",
    }


def test_the_requests_that_may_be_empty_are_known() -> None:
    # A limited key that leaves everything out must not be let in by that.
    empty = [
        name
        for name, each in OPERATIONS.items()
        if name not in WHOLE
        and not any(field.is_required() for field in document_shapes()[each.request].model_fields.values())
    ]
    assert empty == ["CreateWorldTemplate", "GetWorldTemplateBody"]  # the body of nothing is refused to everybody


def test_a_template_that_gets_no_name_needs_all_templates() -> None:
    assert refusal("CreateWorldTemplate", {}, ["simulate"], "world-template/a*")
    assert refusal("CreateWorldTemplate", {"name": "b"}, ["simulate"], "world-template/a*")
    assert not refusal("CreateWorldTemplate", {"name": "ab"}, ["simulate"], "world-template/a*")
    assert not refusal("CreateWorldTemplate", {}, ["simulate"], "world-template/*")


def test_a_template_is_not_renamed_out_of_the_limits() -> None:
    document = {"template": arn("world-template", "a"), "name": "b"}
    assert refusal("UpdateWorldTemplate", document, ["simulate"], "world-template/a")
    assert not refusal("UpdateWorldTemplate", {**document, "name": None}, ["simulate"], "world-template/a")


def test_arns_in_tags_and_roles_are_no_resources() -> None:
    document = document_shapes()["CreateFleetRequest"].model_construct(name="home", tags={"a": "arn:simyard:robot:s:x"})
    assert request_arns(document) == ()
    role = document_shapes()["CreateSimulationJobRequest"].model_construct(iamRole="arn:aws:iam::1:role/x")
    assert request_arns(role) == ()


def test_a_key_without_limits_does_what_its_rights_say() -> None:
    assert not refusal("CreateDeploymentJob", deployment("any"), ["deploy"])
    assert not refusal("ListFleets", {}, ["read"])


def test_a_deployment_of_no_known_fleet_is_within_no_limit() -> None:
    job = {"job": arn("deployment-job", "deployment-gone")}
    assert not refusal("CancelDeploymentJob", job, ["deploy"])
    assert "limits do not cover" in refusal("CancelDeploymentJob", job, ["deploy"], "deployment-fleet/*")
