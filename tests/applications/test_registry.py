import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import cast

import pytest

from specs.errors import BundleRefused, DocumentError, LimitExceeded, ResourceNotFound
from tasks.applications import registry
from tasks.applications.registry import applications, publish_bundle, resolve, unpack
from tasks.storage.base.keys import application_key, bundle_key
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.housekeeping.yard import Meddled

ROBOT = "robot-application"


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return open_store((tmp_path / "store").as_uri())


@pytest.fixture(autouse=True)
def _nothing_shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "shipped_application", lambda _name: None)  # pyright: ignore[reportUnknownLambdaType]


def _bundle(folder: Path, content: str) -> Path:
    package = folder / content / "package"
    package.mkdir(parents=True, exist_ok=True)
    (package / "run.sh").write_text(f"#!/bin/sh\n# {content}\nexec sleep 1000\n")
    (package / "run.sh").chmod(0o755)
    return folder / content


def test_an_unknown_name_is_refused_with_the_one_that_was_probably_meant(store: Store, tmp_path: Path) -> None:
    publish_bundle(store, ROBOT, "rover", _bundle(tmp_path, "first"))
    with pytest.raises(
        ResourceNotFound, match=r'did you mean "rover"\? .*; simyard app publish rovre FOLDER publishes'
    ):
        resolve(store, ROBOT, "rovre")
    with pytest.raises(ResourceNotFound, match=r'did you mean "delivery"\? .*FOLDER --kind simulation publishes one'):
        resolve(store, "simulation-application", "delivry")


def test_new_content_gets_the_next_number_and_old_content_its_old_one(store: Store, tmp_path: Path) -> None:
    first, second = _bundle(tmp_path, "first"), _bundle(tmp_path, "second")

    numbers = [publish_bundle(store, ROBOT, "courier", folder).number for folder in (first, second, first, second)]

    assert numbers == [1, 2, 1, 2]


def test_processes_that_publish_at_once_share_numbers_only_for_the_same_content(store: Store, tmp_path: Path) -> None:
    folders = [_bundle(tmp_path, str(number % 6)) for number in range(24)]

    with ThreadPoolExecutor(12) as pool:
        versions = list(pool.map(lambda folder: publish_bundle(store, ROBOT, "courier", folder), folders))

    assert {version.number for version in versions} == {1, 2, 3, 4, 5, 6}
    assert len({(version.number, version.digest) for version in versions}) == 6


def test_a_bundle_that_a_gc_removed_before_its_version_was_written_is_written_again(
    store: Store, tmp_path: Path
) -> None:
    between = Meddled(store)
    between.before(
        "create", application_key(ROBOT, "courier"), lambda: [store.delete(k) for k in store.keys("bundles")]
    )

    made = publish_bundle(cast("Store", between), ROBOT, "courier", _bundle(tmp_path, "first"))

    assert hashlib.sha256(store.get(bundle_key(made.digest)).body).hexdigest() == made.digest


def test_a_41st_version_is_refused_and_old_ones_can_still_be_published(store: Store, tmp_path: Path) -> None:
    for number in range(40):
        publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, str(number)))

    with pytest.raises(LimitExceeded, match="at most 40 versions"):
        publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "40"))

    assert publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "7")).number == 8


@pytest.mark.parametrize(
    "reference",
    [
        "courier",
        "arn:simyard:robot-application:0123456789ab:courier",
        "arn:aws:robomaker:us-west-2:111111111111:robot-application/courier/1551203485821",
    ],
)
@pytest.mark.parametrize(("version", "number"), [(None, 2), ("$LATEST", 2), ("1", 1), ("2", 2)])
def test_references_of_all_kinds_resolve(
    reference: str, version: str | None, number: int, store: Store, tmp_path: Path
) -> None:
    publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "first"))
    publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "second"))

    assert resolve(store, ROBOT, reference, version).number == number


def test_a_version_that_was_never_published_is_missing(store: Store, tmp_path: Path) -> None:
    publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "first"))

    with pytest.raises(ResourceNotFound, match="a version of courier: 1"):
        resolve(store, ROBOT, "courier", "2")


def test_an_application_that_nobody_published_is_missing(store: Store) -> None:
    with pytest.raises(ResourceNotFound, match="a published robot-application"):
        resolve(store, ROBOT, "courier")


@pytest.mark.parametrize("reference", ["arn:simyard:robot:0123456789ab:courier", "arn:nonsense", "../courier"])
def test_a_reference_to_something_else_is_refused(reference: str, store: Store) -> None:
    with pytest.raises(DocumentError):
        resolve(store, ROBOT, reference)


def test_a_shipped_application_is_published_at_first_reference(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "shipped_application", lambda name: _bundle(tmp_path, name))  # pyright: ignore[reportUnknownLambdaType]

    version = resolve(store, ROBOT, "courier", "1")

    assert (version.number, version.shipped) == (1, True)
    assert store.exists(bundle_key(version.digest))


def test_what_somebody_published_under_a_shipped_name_stays_the_newest(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "shipped_application", lambda _name: _bundle(tmp_path, "shipped"))  # pyright: ignore[reportUnknownLambdaType]
    resolve(store, ROBOT, "courier")
    own = publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "own"))

    assert resolve(store, ROBOT, "courier") == own


def test_latest_follows_a_newer_shipped_application(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = ["old", "new"]
    monkeypatch.setattr(registry, "shipped_application", lambda _name: _bundle(tmp_path, shipped.pop(0)))  # pyright: ignore[reportUnknownLambdaType]

    assert [resolve(store, ROBOT, "courier").number for _ in range(2)] == [1, 2]


def test_a_bundle_unpacks_to_what_was_published(store: Store, tmp_path: Path) -> None:
    source = _bundle(tmp_path, "first")
    version = publish_bundle(store, ROBOT, "courier", source)

    folder = unpack(store, version.digest, tmp_path / "cache")

    assert (folder / "package/run.sh").read_bytes() == (source / "package/run.sh").read_bytes()
    assert (folder / "package/run.sh").stat().st_mode & 0o111


def test_a_bundle_that_was_changed_in_the_store_is_refused_and_leaves_nothing(store: Store, tmp_path: Path) -> None:
    version = publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "first"))
    key = bundle_key(version.digest)
    store.put(key, store.get(key).body.replace(b"sleep", b"steal"))

    with pytest.raises(BundleRefused, match="was changed"):
        unpack(store, version.digest, tmp_path / "cache")

    assert list((tmp_path / "cache").iterdir()) == []


def test_a_bundle_that_was_written_to_is_unpacked_anew(store: Store, tmp_path: Path) -> None:
    version = publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "first"))
    script = unpack(store, version.digest, tmp_path / "cache") / "package/run.sh"
    before = script.read_bytes()
    script.chmod(0o755)
    script.write_bytes(before.replace(b"sleep", b"steal"))

    assert (unpack(store, version.digest, tmp_path / "cache") / "package/run.sh").read_bytes() == before


def test_processes_that_unpack_at_once_get_the_same_whole_folder(store: Store, tmp_path: Path) -> None:
    version = publish_bundle(store, ROBOT, "courier", _bundle(tmp_path, "first"))

    with ThreadPoolExecutor(8) as pool:
        folders = set(pool.map(lambda _: unpack(store, version.digest, tmp_path / "cache"), range(8)))

    assert len(folders) == 1
    assert [path.name for path in (tmp_path / "cache").iterdir()] == [version.digest]


def test_applications_are_listed_by_name(store: Store, tmp_path: Path) -> None:
    for name in ("zebra", "ant"):
        publish_bundle(store, ROBOT, name, _bundle(tmp_path, "same"))

    assert [application.name for application in applications(store, ROBOT)] == ["ant", "zebra"]
