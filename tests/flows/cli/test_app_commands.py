"""Applications on the command line."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.applications.application_answers import describe_robot_application
from tasks.applications.registry import pack, resolve
from tasks.storage.archives import list_bundle_files
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.storage.made_images import docker_archive, file, layer

ROBOT = "robot-application"


def _simyard(store: Store, *arguments: object) -> str:
    words = ["app", *map(str, arguments), "--store", store.url]
    return CliRunner().invoke(app, words, catch_exceptions=False).output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bundle" / "package").mkdir(parents=True)
    (tmp_path / "bundle" / "package" / "run.sh").write_text("one")
    return tmp_path / "bundle"


def test_a_folder_is_published_and_the_same_content_keeps_its_number(file_store: Store, folder: Path) -> None:
    told = [_simyard(file_store, "publish", "mine", folder) for _ in range(2)]

    digest = resolve(file_store, ROBOT, "mine").digest
    assert told == [f"mine version 1: {digest}\n"] * 2


def test_a_container_image_is_published_as_a_document_would(
    file_store: Store, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    (folder / "robot.xml").write_text("<mujoco/>")
    image = docker_archive(tmp_path / "app.tar", [layer(file("usr/bin/roslaunch"))])
    told = _simyard(file_store, "publish", "mine", image, "--robot", folder)

    digest = resolve(file_store, ROBOT, "mine").digest
    assert told == f"mine version 1: {digest}\n"
    assert {"image.json", "robot.xml"} <= {*list_bundle_files(file_store, digest)}
    with pytest.raises(DocumentError, match="a tag may be another image tomorrow"):
        _simyard(file_store, "publish", "mine", "docker://127.0.0.1:1/app:1")
    with pytest.raises(DocumentError, match="it is built for amd64, and ARM64 is asked for"):
        _simyard(file_store, "publish", "mine", "--architecture", f"ARM64={image}")
    assert _simyard(file_store, "publish", "judge", image, "--kind", "simulation").startswith("judge version 1: ")
    with pytest.raises(DocumentError, match="is no container image, and has its own"):
        _simyard(file_store, "publish", "mine", folder, "--robot", folder)


def test_a_scenario_is_published_as_one(file_store: Store, folder: Path) -> None:
    _simyard(file_store, "publish", "mine", folder, "--kind", "simulation")

    assert resolve(file_store, "simulation-application", "mine").number == 1


def test_a_folder_for_each_architecture_is_published(file_store: Store, folder: Path) -> None:
    builds = ("--architecture", f"ARM64={folder}", "--architecture", f"X86_64={folder}")
    told = _simyard(file_store, "publish", "mine", *builds)

    digest = resolve(file_store, ROBOT, "mine").digest
    assert told == f"mine version 1: {digest} X86_64, {digest} ARM64\n"


def test_an_application_of_objects_is_made_updated_versioned_and_deleted(file_store: Store, folder: Path) -> None:
    open_bucket(file_store, "builds").put("a/b.tar", pack(folder))
    revision = _simyard(file_store, "create", "mine", "--source", "ARM64=s3://builds/none.tar").split()[-1]
    update = ("update", "mine", "--source", "ARM64=s3://builds/a/b.tar", "--revision")
    _simyard(file_store, *update, revision)
    with pytest.raises(DocumentError, match="currentRevisionId"):
        _simyard(file_store, *update, revision)

    told = _simyard(file_store, "publish", "mine")
    sources = describe_robot_application(file_store, "mine").sources or ()

    assert told.startswith("mine version 1: ")
    found = [(source.s3Bucket, source.s3Key, source.architecture) for source in sources]
    assert found == [("builds", "a/b.tar", "ARM64")]
    assert _simyard(file_store, "delete", "mine", "--version", 1) == "mine version 1 is deleted; left: none yet\n"
    assert _simyard(file_store, "delete", "mine") == "mine is deleted\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ("create", "mine", "--source", "ARM64=builds/a.tar"),
        ("create", "mine", "--source", "MIPS=s3://builds/a.tar"),
        ("create", "mine", "--source", "ARM64=s3://builds"),
        ("publish", "mine", "--architecture", "ARM64"),
        ("publish", "mine", "--architecture", "ARM64=a", "--architecture", "ARM64=b"),
        ("publish", "mine", "folder", "--architecture", "ARM64=a"),
        ("publish", "mine"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: tuple[str, ...], file_store: Store) -> None:
    with pytest.raises(DocumentError):
        _simyard(file_store, *arguments)
