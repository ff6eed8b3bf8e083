"""Calls about applications."""

import hashlib
import io
import shutil
import tarfile
from pathlib import Path
from threading import Barrier, Thread
from typing import Any

import pytest

from specs.errors import DocumentError, LimitExceeded, ResourceAlreadyExists, ResourceNotFound
from specs.robomaker.bundle import VERSIONS_AT_MOST
from tasks.applications.registry import pack
from tasks.applications.versions import read_application
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import records
from tests.flows.gateway.asked import Asked
from tests.repository import ROOT

SUITE = {"name": "ROS2", "version": "Foxy"}
SIMULATOR = {"name": "Gazebo", "version": "11"}
ENGINE = {"name": "OGRE", "version": "1.x"}
IMAGE = {"uri": "123456789012.dkr.ecr.us-west-2.amazonaws.com/robot:1"}
DIGEST = f"sha256:{'a' * 64}"
SOURCE = {"s3Bucket": "builds", "s3Key": "robot.tar", "architecture": "X86_64"}


def build(gateway: Asked, content: str = "one", key: str = "robot.tar") -> str:
    """Puts a bundle where the application's source is, and returns its etag."""
    tar = io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as archive:
        info = tarfile.TarInfo("file")
        info.size = len(content)
        archive.addfile(info, io.BytesIO(content.encode()))
    return open_bucket(gateway.store, "builds").put(key, tar.getvalue()).strip('"')


def create(gateway: Asked, name: str = "picker", **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateRobotApplication", name=name, robotSoftwareSuite=SUITE, **more)


def test_a_robot_application_is_answered_as_it_was_asked_for(gateway: Asked) -> None:
    etag = build(gateway)
    made = create(gateway, sources=[SOURCE], tags={"team": "arms"}, environment=IMAGE)
    assert made["arn"] == gateway.arn("robot-application", "picker")
    assert (made["version"], made["robotSoftwareSuite"], made["environment"]) == ("$LATEST", SUITE, IMAGE)
    assert made["sources"] == [{**SOURCE, "etag": etag}]
    described = gateway.call("DescribeRobotApplication", application=made["arn"])
    assert described == made
    assert described["tags"] == {"team": "arms"}


def test_a_simulation_application_has_two_suites_and_an_engine(gateway: Asked) -> None:
    made = gateway.call(
        "CreateSimulationApplication",
        name="rooms",
        robotSoftwareSuite=SUITE,
        simulationSoftwareSuite=SIMULATOR,
        renderingEngine=ENGINE,
    )
    described = gateway.call("DescribeSimulationApplication", application=made["arn"])
    assert (described["simulationSoftwareSuite"], described["renderingEngine"]) == (SIMULATOR, ENGINE)
    changed = gateway.call(
        "UpdateSimulationApplication",
        application=made["arn"],
        robotSoftwareSuite=SUITE,
        simulationSoftwareSuite={"name": "SimulationRuntime"},
        sources=[SOURCE],
    )
    assert changed["simulationSoftwareSuite"] == {"name": "SimulationRuntime"}
    assert changed["renderingEngine"] == ENGINE
    build(gateway)
    version = gateway.call("CreateSimulationApplicationVersion", application=made["arn"])
    assert (version["version"], version["renderingEngine"]) == ("1", ENGINE)
    assert gateway.call("DeleteSimulationApplication", application=made["arn"]) == {}


def test_a_version_is_what_latest_was_on_its_day(gateway: Asked) -> None:
    build(gateway)
    made = create(gateway, sources=[SOURCE])
    first = gateway.call("CreateRobotApplicationVersion", application=made["arn"])
    gateway.call(
        "UpdateRobotApplication",
        application=made["arn"],
        robotSoftwareSuite={"name": "General"},
        sources=[{**SOURCE, "s3Key": "other.tar"}],
    )
    described = gateway.call("DescribeRobotApplication", application=made["arn"], applicationVersion="1")
    assert {name: described[name] for name in first} == first
    assert described["robotSoftwareSuite"] == SUITE
    latest = gateway.call("DescribeRobotApplication", application=made["arn"], applicationVersion="$LATEST")
    assert latest["robotSoftwareSuite"] == {"name": "General"}
    assert latest["sources"][0]["s3Key"] == "other.tar"
    assert "etag" not in latest["sources"][0]


def test_another_suite_makes_another_version_of_the_same_bundle(gateway: Asked) -> None:
    build(gateway)
    made = create(gateway, sources=[SOURCE])
    numbers = [gateway.call("CreateRobotApplicationVersion", application=made["arn"])["version"] for _ in range(2)]
    gateway.call("UpdateRobotApplication", application=made["arn"], robotSoftwareSuite={"name": "General"})
    numbers.append(gateway.call("CreateRobotApplicationVersion", application=made["arn"])["version"])
    assert numbers == ["1", "1", "2"]


def test_a_version_is_made_of_the_etags_that_were_asked_for_or_not_at_all(gateway: Asked) -> None:
    etag = build(gateway)
    made = create(gateway, sources=[SOURCE])
    for etags in (["0" * 32], [], [etag, etag]):
        with pytest.raises(DocumentError, match="s3Etags"):
            gateway.call("CreateRobotApplicationVersion", application=made["arn"], s3Etags=etags)
    version = gateway.call("CreateRobotApplicationVersion", application=made["arn"], s3Etags=[f'"{etag}"'])
    assert version["sources"] == [{**SOURCE, "etag": etag}]


def test_an_images_digest_is_kept_where_there_is_an_image(gateway: Asked) -> None:
    build(gateway)
    made = create(gateway, sources=[SOURCE])
    with pytest.raises(DocumentError, match="imageDigest"):
        gateway.call("CreateRobotApplicationVersion", application=made["arn"], imageDigest=DIGEST)
    gateway.call("UpdateRobotApplication", application=made["arn"], robotSoftwareSuite=SUITE, environment=IMAGE)
    gateway.call("CreateRobotApplicationVersion", application=made["arn"], imageDigest=DIGEST)
    described = gateway.call("DescribeRobotApplication", application=made["arn"], applicationVersion="1")
    assert described["imageDigest"] == DIGEST


def test_the_revision_that_was_read_last_is_needed(gateway: Asked) -> None:
    build(gateway)
    old = create(gateway, sources=[SOURCE])["revisionId"]
    application = gateway.arn("robot-application", "picker")
    new = gateway.call(
        "UpdateRobotApplication", application=application, robotSoftwareSuite=SUITE, currentRevisionId=old
    )["revisionId"]
    for call in ("UpdateRobotApplication", "CreateRobotApplicationVersion"):
        more = {"robotSoftwareSuite": SUITE} if call.startswith("Update") else {}
        with pytest.raises(DocumentError, match="currentRevisionId"):
            gateway.call(call, application=application, currentRevisionId=old, **more)
    assert gateway.call("CreateRobotApplicationVersion", application=application, currentRevisionId=new)


def test_a_name_is_taken_once_and_free_after_its_deletion(gateway: Asked) -> None:
    made = create(gateway, tags={"team": "arms"})
    with pytest.raises(ResourceAlreadyExists):
        create(gateway)
    assert gateway.call("DeleteRobotApplication", application=made["arn"]) == {}
    with pytest.raises(ResourceNotFound):
        gateway.call("DescribeRobotApplication", application=made["arn"])
    assert create(gateway)["tags"] == {}


def test_of_many_that_want_a_name_at_once_one_gets_it(gateway: Asked) -> None:
    start, answers = Barrier(6), list[str]()

    def one(number: int) -> None:
        start.wait()
        try:
            create(gateway, tags={"number": str(number)})
        except ResourceAlreadyExists:
            return
        answers.append(str(number))

    threads = [Thread(target=one, args=(number,)) for number in range(6)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    tags = gateway.call("DescribeRobotApplication", application=gateway.arn("robot-application", "picker"))["tags"]
    assert [tags["number"]] == answers


def test_one_application_too_many_is_refused(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_APPLICATIONS", "1")
    create(gateway)
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_APPLICATIONS"):
        create(gateway, "other")
    with pytest.raises(ResourceAlreadyExists):
        create(gateway)
    gateway.call("DeleteRobotApplication", application=gateway.arn("robot-application", "picker"))
    assert create(gateway, "other")


def test_a_41st_version_is_refused(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tasks.applications.versions.VERSIONS_AT_MOST", 2)
    made = create(gateway, sources=[SOURCE])
    for content in ("one", "two"):
        build(gateway, content)
        gateway.call("CreateRobotApplicationVersion", application=made["arn"])
    build(gateway, "three")
    with pytest.raises(LimitExceeded):
        gateway.call("CreateRobotApplicationVersion", application=made["arn"])
    assert VERSIONS_AT_MOST == 40


def test_only_a_deleted_version_is_gone(gateway: Asked) -> None:
    made = create(gateway, sources=[SOURCE])
    for content in ("one", "two"):
        build(gateway, content)
        gateway.call("CreateRobotApplicationVersion", application=made["arn"])
    gateway.call("DeleteRobotApplication", application=made["arn"], applicationVersion="1")
    with pytest.raises(ResourceNotFound):
        gateway.call("DescribeRobotApplication", application=made["arn"], applicationVersion="1")
    assert gateway.call("DescribeRobotApplication", application=made["arn"], applicationVersion="2")["version"] == "2"


def test_a_job_without_a_version_runs_what_lies_at_the_sources_now(gateway: Asked, tmp_path: Path) -> None:
    source = {"s3Bucket": "builds", "s3Key": "courier.tar", "architecture": "X86_64"}
    gateway.call("CreateRobotApplication", name="courier", robotSoftwareSuite=SUITE, sources=[source])
    world, digests = gateway.world(), list[str]()
    for content in ("one", "one", "two"):
        shutil.copytree(ROOT / "applications/courier", tmp_path / "courier", dirs_exist_ok=True)
        (tmp_path / "courier/note.txt").write_text(content)
        body = pack(tmp_path / "courier")
        open_bucket(gateway.store, "builds").put("courier.tar", body)
        gateway.call("CreateSimulationJob", **gateway.job_request(world))
        digests.append(hashlib.sha256(body).hexdigest())
    plans = [each.request["plan"] for each in records(gateway.store, "simulation-job-batch")]
    assert [digest in str(plan) for digest, plan in zip(digests, plans, strict=True)] == [True, True, True]
    application = read_application(gateway.store, "robot-application", "courier")
    assert application
    assert [(each.number, each.brought) for each in application.versions] == [(1, True), (2, True)]
    open_bucket(gateway.store, "builds").delete("courier.tar")
    with pytest.raises(DocumentError, match=r"s3://builds/courier\.tar"):
        gateway.call("CreateSimulationJob", **gateway.job_request(world))


def test_an_application_that_comes_with_simyard_is_described(gateway: Asked) -> None:
    described = gateway.call("DescribeRobotApplication", application=gateway.arn("robot-application", "courier"))
    assert (described["version"], described["robotSoftwareSuite"]) == ("1", {"name": "General"})
