"""Applications made of objects in buckets: created, versioned, updated, changed behind one's back, deleted."""

import io
import tarfile
from pathlib import Path
from typing import cast

import pytest

from specs.errors import DocumentError, LimitExceeded, ResourceNotFound
from specs.robomaker.applications import SourceConfig
from specs.robomaker.bundle import Version
from tasks.applications.application_answers import describe_robot_application, list_robot_applications
from tasks.applications.bucket_sources import create_application, create_version, delete_application, update_application
from tasks.applications.registry import pack, publish_bundle, resolve
from tasks.storage.base.keys import application_key, bundle_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket, source_faults
from tests.housekeeping.yard import Meddled

ROBOT = "robot-application"
BUCKET = "builds"
AMD, ARM = (SourceConfig(s3Bucket=BUCKET, s3Key=f"{each}.tar", architecture=each) for each in ("X86_64", "ARM64"))


def _bundle(folder: Path, content: str) -> Path:
    (folder / content / "package").mkdir(parents=True, exist_ok=True)
    (folder / content / "package" / "run.sh").write_text(content)
    return folder / content


def _build(store: Store, tmp_path: Path, content: str, architecture: str = "X86_64") -> bytes:
    body = pack(_bundle(tmp_path, content))
    open_bucket(store, BUCKET).put(f"{architecture}.tar", body)
    return body


@pytest.fixture
def made(file_store: Store, tmp_path: Path) -> Version:
    """Version 1 of an application with two sources."""
    _build(file_store, tmp_path, "amd")
    _build(file_store, tmp_path, "arm", "ARM64")
    create_application(file_store, ROBOT, "courier", [ARM, AMD])
    return create_version(file_store, ROBOT, "courier")


def test_a_version_has_the_bytes_that_lie_at_each_source(made: Version, file_store: Store, tmp_path: Path) -> None:
    bodies = [file_store.get(bundle_key(build.digest)).body for build in made.builds]

    assert [build.architecture for build in made.builds] == ["X86_64", "ARM64"]
    assert bodies == [pack(_bundle(tmp_path, "amd")), pack(_bundle(tmp_path, "arm"))]
    assert made.digest == made.builds[0].digest
    assert create_version(file_store, ROBOT, "courier") == made


def test_a_bundle_that_a_gc_removed_before_its_version_was_written_is_taken_again(
    file_store: Store, tmp_path: Path
) -> None:
    body = _build(file_store, tmp_path, "amd")
    create_application(file_store, ROBOT, "courier", [AMD])
    between, key = Meddled(file_store), application_key(ROBOT, "courier")
    between.before("replace", key, lambda: [file_store.delete(each) for each in file_store.keys("bundles")])

    made = create_version(cast("Store", between), ROBOT, "courier")

    assert file_store.get(bundle_key(made.digest)).body == body


def test_sources_are_described_with_the_etags_they_had(made: Version, file_store: Store) -> None:
    described = describe_robot_application(file_store, "courier")

    found = [(source.architecture, source.s3Bucket, source.s3Key) for source in described.sources or ()]
    assert found == [("X86_64", BUCKET, "X86_64.tar"), ("ARM64", BUCKET, "ARM64.tar")]
    etags = [source.etag for source in described.sources or ()]
    assert etags == [open_bucket(file_store, BUCKET).etag(f"{each}.tar") for each in ("X86_64", "ARM64")]
    assert (described.version, described.revisionId) == ("1", made.revision)


def test_a_source_that_changed_since_is_told_until_there_is_a_version_of_it(
    made: Version, file_store: Store, tmp_path: Path
) -> None:
    assert source_faults(file_store, made, "here") == []
    _build(file_store, tmp_path, "rebuilt")

    (fault,) = source_faults(file_store, made, "here")
    newer = create_version(file_store, ROBOT, "courier")

    assert (fault.path, "RobotApplicationVersionMismatchedEtag" in fault.value) == ("here", True)
    assert newer.number == 2
    assert source_faults(file_store, newer, "here") == []
    assert len(source_faults(file_store, made, "here")) == 1


def test_a_source_that_is_gone_is_told(made: Version, file_store: Store) -> None:
    open_bucket(file_store, BUCKET).delete("ARM64.tar")

    (fault,) = source_faults(file_store, made, "here")

    assert "is gone" in fault.value


def test_an_etag_is_remembered_as_the_server_of_the_bucket_gives_it(
    s3_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _build(s3_store, tmp_path, "amd")
    create_application(s3_store, ROBOT, "courier", [AMD])
    version = create_version(s3_store, ROBOT, "courier")
    assert source_faults(s3_store, version, "here") == []

    _build(s3_store, tmp_path, "rebuilt")

    assert len(source_faults(s3_store, version, "here")) == 1


def test_what_lies_there_must_be_a_bundle(file_store: Store) -> None:
    create_application(file_store, ROBOT, "courier", [AMD])
    bucket = open_bucket(file_store, BUCKET)
    tar = io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("../outside"))
    for body in (None, b"no tar", tar.getvalue()):
        if body is not None:
            bucket.put("X86_64.tar", body)
        with pytest.raises(DocumentError, match=r"s3://builds/X86_64\.tar"):
            create_version(file_store, ROBOT, "courier")
    assert resolve_numbers(file_store) == []


def resolve_numbers(store: Store) -> list[str | None]:
    return [each.version for each in list_robot_applications(store) if each.version != "$LATEST"]


def test_an_application_is_made_once(file_store: Store) -> None:
    create_application(file_store, ROBOT, "courier", [])

    with pytest.raises(DocumentError, match="a name that no robot-application has"):
        create_application(file_store, ROBOT, "courier", [])


def test_an_application_without_versions_is_described_and_cannot_be_used(file_store: Store) -> None:
    made = create_application(file_store, ROBOT, "picker", [ARM])

    described = describe_robot_application(file_store, "picker")

    assert (described.version, described.revisionId) == ("$LATEST", made.revision)
    assert [source.s3Key for source in described.sources or ()] == ["ARM64.tar"]
    assert [each.name for each in list_robot_applications(file_store)] == ["picker"]
    with pytest.raises(ResourceNotFound, match="none yet"):
        resolve(file_store, ROBOT, "picker")


def test_an_update_needs_the_revision_that_was_read_last(file_store: Store) -> None:
    first = create_application(file_store, ROBOT, "courier", [AMD]).revision
    second = update_application(file_store, ROBOT, "courier", [ARM], first).revision
    with pytest.raises(DocumentError, match="currentRevisionId"):
        update_application(file_store, ROBOT, "courier", [AMD], first)
    third = update_application(file_store, ROBOT, "courier", [AMD], second).revision

    assert len({first, second, third}) == 3


def test_a_version_needs_the_revision_that_was_read_last(file_store: Store, tmp_path: Path) -> None:
    revision = create_application(file_store, ROBOT, "courier", []).revision
    publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, "one"), current_revision=revision)

    with pytest.raises(DocumentError, match="currentRevisionId"):
        publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, "two"), current_revision=revision)
    with pytest.raises(DocumentError, match="currentRevisionId"):
        create_version(file_store, ROBOT, "courier", revision)


@pytest.mark.parametrize("sources", [[AMD, AMD], [SourceConfig(architecture="ARM64")]])
def test_sources_that_contradict_each_other_are_refused(sources: list[SourceConfig], file_store: Store) -> None:
    with pytest.raises(DocumentError, match="sources"):
        create_application(file_store, ROBOT, "courier", sources)


def test_a_number_is_never_given_again(file_store: Store, tmp_path: Path) -> None:
    numbers = [publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, each)).number for each in ("one", "two")]
    delete_application(file_store, ROBOT, "courier", "2")
    numbers.append(publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, "two")).number)
    delete_application(file_store, ROBOT, "courier", "3")
    delete_application(file_store, ROBOT, "courier")
    with pytest.raises(ResourceNotFound):
        delete_application(file_store, ROBOT, "courier")
    create_application(file_store, ROBOT, "courier", [])
    numbers.append(publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, "one")).number)

    assert numbers == [1, 2, 3, 4]


def test_what_is_deleted_is_gone_for_who_asks_and_not_for_who_runs_it(file_store: Store, tmp_path: Path) -> None:
    first, second = (publish_bundle(file_store, ROBOT, "mine", _bundle(tmp_path, each)) for each in ("one", "two"))
    delete_application(file_store, ROBOT, "mine", "2")
    assert resolve(file_store, ROBOT, "mine") == first
    with pytest.raises(ResourceNotFound, match="a version of mine: 1"):
        resolve(file_store, ROBOT, "mine", "2")
    with pytest.raises(ResourceNotFound, match="a version of mine: 1"):
        delete_application(file_store, ROBOT, "mine", "2")
    delete_application(file_store, ROBOT, "mine")

    with pytest.raises(ResourceNotFound):
        resolve(file_store, ROBOT, "mine", "1")
    assert list(list_robot_applications(file_store)) == []
    assert file_store.exists(bundle_key(second.digest))


def test_a_deleted_version_makes_room_for_another(file_store: Store, tmp_path: Path) -> None:
    for number in range(40):
        publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, str(number)))
    delete_application(file_store, ROBOT, "courier", "7")

    assert publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, "40")).number == 41
    with pytest.raises(LimitExceeded):
        publish_bundle(file_store, ROBOT, "courier", _bundle(tmp_path, "41"))


def test_a_folder_for_each_architecture_is_another_version_than_one_for_all(file_store: Store, tmp_path: Path) -> None:
    one, two = _bundle(tmp_path, "one"), _bundle(tmp_path, "two")
    whole = publish_bundle(file_store, ROBOT, "courier", one)
    built = publish_bundle(file_store, ROBOT, "courier", {"ARMHF": two, "X86_64": one})
    again = publish_bundle(file_store, ROBOT, "courier", {"X86_64": one, "ARMHF": two})

    assert (whole.number, built.number, again) == (1, 2, built)
    assert (built.digest, whole.builds) == (whole.digest, ())
    assert list(built.digests) == ["X86_64", "ARMHF"]
