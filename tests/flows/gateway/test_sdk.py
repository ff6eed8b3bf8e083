"""The calls about resources as boto3's core makes them, with each error that is documented for one."""

import io
import json
import tarfile
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from botocore.exceptions import ClientError

from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.gateway.robomaker_client import client_of, running_application
from tests.worlds.templates import SAMPLES

BODY = SAMPLES[0].read_text()
SUITES = {"robotSoftwareSuite": {"name": "ROS2"}, "simulationSoftwareSuite": {"name": "Gazebo", "version": "11"}}
Client = Any
"""botocore has no types."""
ROBOT = {"architecture": "X86_64", "greengrassGroupId": "g"}


@pytest.fixture
def client(file_store: Store, tmp_path: Path) -> Generator[Client]:
    with running_application(file_store) as send:
        yield client_of(send, tmp_path / "models")


def code_of(call: Client, **members: Client) -> str:
    with pytest.raises(ClientError) as refused:
        call(**members)
    return refused.value.response["Error"]["Code"].removesuffix("Exception")


def absent(arn: str) -> str:
    return arn[:-1] + ("0" if arn[-1] != "0" else "1")


def test_an_application_lives_and_its_errors_are_told(
    client: Client, file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    tar = io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("file"))
    open_bucket(file_store, "builds").put("rooms.tar", tar.getvalue())
    sources = [{"s3Bucket": "builds", "s3Key": "rooms.tar", "architecture": "X86_64"}]

    made = client.create_simulation_application(name="rooms", sources=sources, tags={"team": "arms"}, **SUITES)
    revision = client.update_simulation_application(application=made["arn"], sources=sources, **SUITES)["revisionId"]
    version = client.create_simulation_application_version(application=made["arn"], currentRevisionId=revision)
    described = client.describe_simulation_application(application=made["arn"], applicationVersion="1")

    assert made["arn"].startswith("arn:aws:robomaker:us-west-2:")
    assert (described["version"], described["tags"]) == (version["version"], {"team": "arms"})
    monkeypatch.setenv("SIMYARD_MAX_APPLICATIONS", "1")
    assert code_of(client.create_simulation_application, name="rooms", **SUITES) == "ResourceAlreadyExists"
    assert code_of(client.create_simulation_application, name="other", **SUITES) == "LimitExceeded"
    assert code_of(client.describe_simulation_application, application=absent(made["arn"])) == "ResourceNotFound"
    assert code_of(client.describe_robot_application, application=made["arn"]) == "InvalidParameter"
    assert (
        code_of(client.update_simulation_application, application=absent(made["arn"]), **SUITES) == "ResourceNotFound"
    )
    assert code_of(client.create_simulation_application_version, application=absent(made["arn"])) == "InvalidParameter"
    monkeypatch.setattr("tasks.applications.versions.VERSIONS_AT_MOST", 1)
    open_bucket(file_store, "builds").put("rooms.tar", tar.getvalue() + bytes(512))
    assert code_of(client.create_simulation_application_version, application=made["arn"]) == "LimitExceeded"
    client.delete_simulation_application(application=made["arn"])
    assert code_of(client.delete_simulation_application, application=made["arn"]) == "InvalidParameter"


def test_a_template_lives_and_its_errors_are_told(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    made = client.create_world_template(name="flat", templateBody=BODY, clientRequestToken="t", tags={"team": "arms"})
    client.update_world_template(template=made["arn"], name="house")

    described = client.describe_world_template(template=made["arn"])

    assert (described["name"], described["clientRequestToken"]) == ("house", "t")
    assert json.loads(client.get_world_template_body(template=made["arn"])["templateBody"])["Buildings"]
    monkeypatch.setenv("SIMYARD_MAX_TEMPLATES", "1")
    assert code_of(client.create_world_template, name="house", templateBody=BODY) == "ResourceAlreadyExists"
    assert code_of(client.create_world_template, name="other", templateBody=BODY) == "LimitExceeded"
    assert code_of(client.create_world_template, templateBody=BODY, clientRequestToken="t") == "InvalidParameter"
    assert code_of(client.create_world_template, templateBody="{") == "InvalidParameter"
    place = {"s3Bucket": "nowhere", "s3Key": "flat.json"}
    assert code_of(client.create_world_template, templateLocation=place) == "ResourceNotFound"
    assert code_of(client.get_world_template_body) == "InvalidParameter"
    client.delete_world_template(template=made["arn"])
    for call in (client.describe_world_template, client.delete_world_template, client.get_world_template_body):
        assert code_of(call, template=made["arn"]) == "ResourceNotFound"
    assert code_of(client.update_world_template, template=made["arn"], name="x") == "ResourceNotFound"


def test_a_fleet_lives_and_its_errors_are_told(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    fleet, robot = client.create_fleet(name="f", tags={"site": "north"})["arn"], client.create_robot(name="r", **ROBOT)
    pair = {"fleet": fleet, "robot": robot["arn"]}

    answer = client.register_robot(**pair)

    assert {name: answer[name] for name in pair} == pair
    assert client.describe_fleet(fleet=fleet)["robots"][0]["greenGrassGroupId"] == "g"
    assert client.describe_robot(robot=robot["arn"])["fleetArn"] == fleet
    for setting in ("FLEETS", "ROBOTS", "FLEET_ROBOTS"):
        monkeypatch.setenv(f"SIMYARD_MAX_{setting}", "1")
    assert code_of(client.create_fleet, name="g") == "LimitExceeded"
    assert code_of(client.create_robot, name="r", **ROBOT) == "ResourceAlreadyExists"
    assert code_of(client.create_robot, name="s", **ROBOT) == "LimitExceeded"
    monkeypatch.setenv("SIMYARD_MAX_ROBOTS", "2")
    other = client.create_robot(name="s", **ROBOT)["arn"]
    assert code_of(client.register_robot, fleet=fleet, robot=other) == "LimitExceeded"
    assert code_of(client.deregister_robot, fleet=fleet, robot=other) == "ResourceNotFound"
    client.deregister_robot(**pair)
    client.delete_robot(robot=other)
    client.delete_fleet(fleet=fleet)
    assert code_of(client.describe_fleet, fleet=fleet) == "ResourceNotFound"
    assert code_of(client.describe_robot, robot=other) == "ResourceNotFound"
    assert code_of(client.register_robot, **pair) == "ResourceNotFound"
    assert code_of(client.delete_fleet, fleet=fleet) == "InvalidParameter"
    assert code_of(client.delete_robot, robot=other) == "InvalidParameter"


def test_tags_and_worlds_are_changed_and_their_errors_are_told(client: Client) -> None:
    fleet = client.create_fleet(name="f", tags={"site": "north"})["arn"]

    client.tag_resource(resourceArn=fleet, tags={"shift": "night", "a/b=c:d": "e f"})
    client.untag_resource(resourceArn=fleet, tagKeys=["site", "a/b=c:d"])

    assert client.list_tags_for_resource(resourceArn=fleet)["tags"] == {"shift": "night"}
    assert client.describe_fleet(fleet=fleet)["tags"] == {"shift": "night"}
    assert code_of(client.list_tags_for_resource, resourceArn=absent(fleet)) == "ResourceNotFound"
    assert code_of(client.tag_resource, resourceArn=fleet, tags={"aws:x": "y"}) == "InvalidParameter"
    assert code_of(client.untag_resource, resourceArn=absent(fleet), tagKeys=["x"]) == "ResourceNotFound"
    world = fleet.replace("deployment-fleet/f", "world/wgj-0123456789abcdef/w")
    assert code_of(client.describe_world, world=world) == "ResourceNotFound"
    assert client.batch_delete_worlds(worlds=[world, fleet])["unprocessedWorlds"] == [fleet, world]
