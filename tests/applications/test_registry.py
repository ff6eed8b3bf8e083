"""Bundles are packed to the same bytes and published under numbers, also by several at once."""

import hashlib
import logging
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import BundleRefused, DocumentError, LimitExceeded, ResourceNotFound
from tasks.applications import registry
from tasks.applications.registry import applications, pack, publish_bundle, resolve, shipped_application, unpack
from tasks.applications.versions import read_application
from tasks.storage.archives import extract
from tasks.storage.base.keys import application_key, bundle_key
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.housekeeping.yard import Meddled
from tests.servers.racers import in_processes
from tests.servers.swap_racers import add_versions_for

NAMES = st.text("abcXYZ019_-.é", min_size=1, max_size=8).filter(lambda name: name not in {".", ".."})
TREES = st.dictionaries(NAMES, st.tuples(st.binary(max_size=50), st.booleans()), min_size=1, max_size=6)


@given(tree=TREES)
def test_packing_and_unpacking_gives_the_same_files_back(
    tree: dict[str, tuple[bytes, bool]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    home = tmp_path_factory.mktemp("bundle")
    _write(home / "in", tree)

    (home / "bundle.tar").write_bytes(pack(home / "in"))
    extract(home / "bundle.tar", home / "out")

    assert _tree(home / "out") == _tree(home / "in") == tree


@given(tree=TREES)
def test_equal_folders_give_equal_bytes_whenever_they_were_made(
    tree: dict[str, tuple[bytes, bool]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    home = tmp_path_factory.mktemp("bundle")
    _write(home / "first", tree)
    _write(home / "second", dict(reversed(tree.items())))
    for path in (home / "second").iterdir():
        os.utime(path, (1, 1))
        path.chmod(path.stat().st_mode & ~0o044)

    assert pack(home / "first") == pack(home / "second")


def test_a_changed_executable_bit_changes_the_archive(tmp_path: Path) -> None:
    _write(tmp_path, {"run.sh": (b"", False)})
    before = pack(tmp_path)
    (tmp_path / "run.sh").chmod(0o755)

    assert pack(tmp_path) != before


def test_leavings_of_tools_change_nothing(tmp_path: Path) -> None:
    _write(tmp_path, {"run.py": (b"pass", False)})
    before = pack(tmp_path)
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__/run.cpython-311.pyc").write_bytes(b"compiled")

    assert pack(tmp_path) == before


def test_every_link_and_pipe_is_named_in_one_error(tmp_path: Path) -> None:
    (tmp_path / "package").mkdir()
    (tmp_path / "package/run.sh").write_text("#!/bin/sh\n")
    (tmp_path / "package/passwords").symlink_to("/etc/passwd")
    (tmp_path / "everything").symlink_to("/")
    os.mkfifo(tmp_path / "pipe")

    with pytest.raises(DocumentError) as caught:
        pack(tmp_path)

    assert [fault.path for fault in caught.value.faults] == ["everything", "package/passwords", "pipe"]


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_a_folder_without_files_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()

    with pytest.raises(DocumentError, match="a folder"):
        pack(tmp_path / name)


def _write(folder: Path, tree: dict[str, tuple[bytes, bool]]) -> None:
    folder.mkdir(exist_ok=True)
    for name, (body, executable) in tree.items():
        (folder / name).write_bytes(body)
        (folder / name).chmod(0o755 if executable else 0o644)


def _tree(folder: Path) -> dict[str, tuple[bytes, bool]]:
    return {path.name: (path.read_bytes(), bool(path.stat().st_mode & 0o100)) for path in folder.iterdir()}


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


_LOG = logging.getLogger(__name__)


@pytest.mark.parametrize(
    ("processes", "seconds"),
    [pytest.param(3, 1.0, marks=pytest.mark.long), pytest.param(8, 10.0, marks=pytest.mark.soak)],
)
def test_every_version_that_was_acknowledged_has_a_number_of_its_own_and_none_is_left_out(
    store: Store, processes: int, seconds: float
) -> None:
    names = ["courier", "guide"]
    told = in_processes(add_versions_for, [(store.url, f"p{each}", names, seconds) for each in range(processes)])
    assert [wrong for each in told for wrong in each.wrong] == []
    done = [done.split() for each in told for done in each.done]
    _LOG.info("versions, %s: %d acknowledged", store.url[:4], len(done))
    for name in names:
        numbers = sorted(int(number) for application, number in done if application == name)
        found = read_application(store, "robot-application", name)
        assert numbers == list(range(1, (found.last_number if found else 0) + 1))


@pytest.mark.parametrize("name", ["courier", "delivery"])
def test_the_applications_that_ship_with_simyard_are_found_and_can_be_packed(name: str) -> None:
    folder = shipped_application(name)

    assert folder is not None
    assert pack(folder)


@pytest.mark.parametrize("name", ["nothing", "..", "../applications/courier", "", "courier/courier"])
def test_no_other_name_leads_anywhere(name: str) -> None:
    assert shipped_application(name) is None
