"""Data sources as a plan has them: pinned by content, or with why they cannot be had."""

import errno
import io
import os
import stat
import tarfile
import warnings
import zipfile
from pathlib import Path
from typing import Any

import pytest

from specs.data.episode import EpisodeResult
from specs.errors import BundleRefused, DocumentError, StoreUnreachable
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.bundle import ApplicationKind, Version
from specs.robomaker.simulation import DataSourceConfig
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.data.data_sources import DATA_PREFIX, PinnedFile, PinnedSource, within_limits
from tasks.simulate.data.mounts import ENDINGS, Mounts, pin_source, unpack_archive
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import plan_batch
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tests.factories.data_buckets import ONE, cache, source
from tests.factories.episodes import passed
from tests.factories.planned_batches import begun, plan, put_world, template


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (source("maps/lost.yaml"), ("InvalidS3Resource", "there is no maps-bucket/maps/lost.yaml")),
        (source("maps"), ("InvalidS3Resource", "there is no maps-bucket/maps")),
        (source("../", type="Prefix"), ("InvalidInput", "'..'")),
        (source("/etc/passwd"), ("InvalidInput", "'/etc/passwd'")),
        (source(".hidden"), ("InvalidInput", "'.hidden'")),
        (source("lost/", type="Prefix"), ("InvalidS3Resource", "nothing below maps-bucket/lost/")),
        (source("maps/one.yaml", type="Archive"), ("InvalidInput", ".zip or .tar.gz")),
        (source("../one.yaml"), ("InvalidInput", "../one.yaml")),
        (source("maps/one.yaml", destination="/../etc"), ("InvalidInput", "'/../etc'")),
    ],
)
def test_what_cannot_be_fetched_is_told_with_robomakers_code(
    file_store: Store, bucket: Store, tmp_path: Path, asked: DataSourceConfig, why: tuple[str, str]
):
    found = pin_source(file_store, cache(tmp_path), asked)
    assert found.failure_code == why[0]
    assert why[1] in found.failure_reason
    assert found.failure_reason.startswith("data source maps: ")


def test_what_a_row_says_does_not_depend_on_where_the_store_is(bucket: Store, tmp_path: Path):
    elsewhere = open_store((tmp_path / "elsewhere").as_uri())
    open_bucket(elsewhere, "maps-bucket").put("other", b"")
    here = open_store(bucket.url.rpartition("/buckets/")[0])
    for asked in (source("maps/lost.yaml"), source("lost/", type="Prefix")):
        assert pin_source(here, cache(tmp_path), asked) == pin_source(elsewhere, cache(tmp_path), asked)


def test_a_bucket_that_nobody_answers_for_is_no_jobs_fault(
    file_store: Store, bucket: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def unreachable(*_: object, **__: object) -> None:
        raise StoreUnreachable("the server knows no such bucket")

    for method in ("get", "head", "keys", "download"):
        monkeypatch.setattr(type(bucket), method, unreachable, raising=False)
    with pytest.raises(StoreUnreachable, match="no such bucket"):
        pin_source(file_store, cache(tmp_path), source("maps/one.yaml"))


def test_planning_again_fetches_nothing_that_nobody_wrote(
    file_store: Store, bucket: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    first = pin_source(file_store, cache(tmp_path), source("maps/one.yaml"))
    fetched: list[str] = []
    download = type(bucket).download

    def counted(self: Store, key: str, target: Path) -> None:
        fetched.append(key)
        download(self, key, target)

    monkeypatch.setattr(type(bucket), "download", counted)
    again = pin_source(file_store, cache(tmp_path), source("maps/one.yaml"))
    assert again == first
    assert [file.etag for file in again.files] == [bucket.etag("maps/one.yaml").strip('"')]
    assert fetched == []
    bucket.put("maps/one.yaml", b"new")
    assert pin_source(file_store, cache(tmp_path), source("maps/one.yaml")) != first
    assert fetched == ["maps/one.yaml"]


def test_the_same_content_is_the_same_source_whatever_the_bucket_calls_it():
    file = PinnedFile(key="k", sha256="0" * 64, size_bytes=1)
    pinned = PinnedSource(name="a", bucket="b", type="File", destination="d", files=(file,))
    named = pinned.model_copy(update={"files": (file.model_copy(update={"etag": "5-2"}),)})
    assert (named.digest, named.model_dump(mode="json")) == (pinned.digest, pinned.model_dump(mode="json"))


def test_more_than_a_job_may_have_is_refused_for_all_its_sources():
    file = PinnedFile(key="k", sha256="0" * 64, size_bytes=1)
    half = PinnedSource(name="a", bucket="b", type="Prefix", destination="d", files=(file,) * 50)
    assert not any(each.failure_code for each in within_limits((half, half)))
    full = within_limits((half, half, half))
    assert {each.failure_code for each in full} == {"LimitExceeded"}
    big = half.model_copy(update={"files": (file.model_copy(update={"size_bytes": (25 << 30) + 1}),)})
    assert within_limits((big,))[0].failure_code == "LimitExceeded"


def mounted(store: Store, found: PinnedSource, tmp_path: Path) -> Path:
    """Returns the folder that an application is told."""
    made = plan(store, templates=(template(environment={"DATA_SOURCE_MAPS": f"{DATA_PREFIX}{found.digest}"}),))
    mounts = Mounts(store, {found.digest: found}, cache(tmp_path))
    request = begun(store, made.model_copy(update={"data_sources": {found.digest: found}})).layout.request(0)
    assert mounts.failure(request) is None
    return Path(mounts.resolved(request).environment["DATA_SOURCE_MAPS"])


def test_files_lie_below_their_whole_key_where_the_variable_says_and_cannot_be_written(
    file_store: Store, bucket: Store, tmp_path: Path
):
    folder = mounted(file_store, pin_source(file_store, cache(tmp_path), source("maps/one.yaml")), tmp_path)
    assert folder.as_posix().endswith("/opt/robomaker/datasources/maps")
    assert (folder / "maps/one.yaml").read_bytes() == ONE
    modes = {stat.S_IMODE(path.stat().st_mode) & 0o222 for path in folder.rglob("*")}
    assert modes == {0}


def test_a_prefix_means_all_that_begin_with_it(file_store: Store, bucket: Store, tmp_path: Path):
    all_of_them = pin_source(file_store, cache(tmp_path), source("maps/", type="Prefix"))
    assert [file.key for file in all_of_them.files] == ["maps/deep/two.yaml", "maps/one.yaml"]
    half_a_name = pin_source(file_store, cache(tmp_path), source("maps", type="Prefix"))
    assert [file.key for file in half_a_name.files] == ["maps/deep/two.yaml", "maps/one.yaml", "mapsakes.txt"]
    folder = mounted(file_store, all_of_them, tmp_path)
    assert (folder / "maps/deep/two.yaml").read_bytes() == b"two"


def test_a_destination_is_where_the_files_lie(file_store: Store, bucket: Store, tmp_path: Path):
    found = pin_source(file_store, cache(tmp_path), source("maps/one.yaml", destination="/home/robot/maps"))
    assert mounted(file_store, found, tmp_path).as_posix().endswith("/home/robot/maps")


def _zip(**files: bytes) -> bytes:
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w") as archive:
        for name, content in files.items():
            archive.writestr(name.replace("__", "/"), content)
    return body.getvalue()


def _damaged(method: int) -> bytes:
    """Returns a zip whose only member's compressed bytes are not what they were."""
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", method) as archive:
        archive.writestr("map", bytes(range(256)) * 40)
    whole = bytearray(body.getvalue())
    whole[60:80] = bytes(20)
    return bytes(whole)


def _tar(name: str, content: bytes) -> bytes:
    body = io.BytesIO()
    with tarfile.open(fileobj=body, mode="w:gz") as archive:
        member = tarfile.TarInfo(name)
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    return body.getvalue()


def test_archives_are_unpacked_side_by_side(file_store: Store, bucket: Store, tmp_path: Path):
    bucket.put("a.zip", _zip(rooms__one=b"1", two=b"2"))
    bucket.put("b.tar.gz", _tar("three", b"3"))
    folder = mounted(
        file_store, pin_source(file_store, cache(tmp_path), source("a.zip", "b.tar.gz", type="Archive")), tmp_path
    )
    found = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert found == {"rooms/one": b"1", "two": b"2", "three": b"3"}


@pytest.mark.parametrize(
    "body", [b"no archive", _tar("../out", b"x"), _zip(two=b"2")[:-30]], ids=["text", "tar", "cut"]
)
@pytest.mark.parametrize("key", ["a.zip", "a.tar.gz"])
def test_an_archive_that_is_none_or_would_write_elsewhere_fails_its_jobs(
    file_store: Store, bucket: Store, tmp_path: Path, body: bytes, key: str
):
    bucket.put(key, body)
    batch = begun(file_store, _planned(file_store, [source(key, type="Archive")]))
    rows = _rows_of_chunk(batch.store, batch.id, 0, run_chunk(batch, 0, _reading, lanes=16, left_s=3600.0).episodes)
    assert {row.failure_code for row in rows} == {"InvalidS3Resource"}
    assert not list(tmp_path.rglob("out"))


@pytest.mark.parametrize(
    "method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA], ids=["deflate", "bzip2", "lzma"]
)
def test_a_damaged_archive_fails_its_jobs_and_leaves_nothing_behind(
    file_store: Store, bucket: Store, tmp_path: Path, method: int
):
    bucket.put("a.zip", _damaged(method))
    batch = begun(file_store, _planned(file_store, [source("a.zip", type="Archive")]))
    run_chunk(batch, 0, _reading, lanes=16, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert {row.failure_code for row in rows} == {"InvalidS3Resource"}
    assert not list((cache(tmp_path) / "mounts").iterdir())


@pytest.mark.parametrize("names", [("a", "a"), ("a", "a/b"), ("a/b", "a"), ("a/", "a"), ("a", "a/"), ("a/b", "a/b/c")])
@pytest.mark.parametrize("ending", ENDINGS)
def test_an_archive_whose_entries_stand_in_each_others_place_is_refused_by_their_name(
    tmp_path: Path, names: tuple[str, str], ending: str
):
    archive = tmp_path / f"archive{ending}"
    with warnings.catch_warnings(action="ignore"):  # zipfile warns of names that are there twice
        if ending == ".zip":
            with zipfile.ZipFile(archive, "w") as opened:
                for name in names:
                    opened.writestr(name, b"")
        else:
            with tarfile.open(archive, "w:gz") as opened:
                for name in names:
                    member = tarfile.TarInfo(name.rstrip("/"))
                    member.type = tarfile.DIRTYPE if name.endswith("/") else tarfile.REGTYPE
                    opened.addfile(member)
    with pytest.raises(BundleRefused, match="is in the archive twice") as caught:
        unpack_archive(archive, archive.name, tmp_path / "out")
    assert str(tmp_path) not in str(caught.value)


def test_a_full_disk_is_no_fault_of_the_archive_and_leaves_nothing_behind(
    file_store: Store, bucket: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "no space left")

    batch = begun(file_store, _planned(file_store, [source("maps/one.yaml")]))
    monkeypatch.setattr("tasks.simulate.data.mounts.shutil.copyfileobj", full)
    with pytest.raises(OSError, match="no space left"):
        run_chunk(batch, 0, _reading, lanes=16, left_s=3600.0)
    assert not list((cache(tmp_path) / "mounts").iterdir())


def test_two_archives_with_the_same_file_are_told_by_name_and_not_by_place(
    file_store: Store, bucket: Store, tmp_path: Path
):
    for key in ("a.zip", "b.zip"):
        bucket.put(key, _zip(same=b"1"))
    found = pin_source(file_store, cache(tmp_path), source("a.zip", "b.zip", type="Archive"))
    mounts = Mounts(file_store, {found.digest: found}, cache(tmp_path))
    made = plan(file_store, templates=(template(environment={"DATA_SOURCE_MAPS": f"{DATA_PREFIX}{found.digest}"}),))
    failure = mounts.failure(Layout(made).request(0))
    assert str(failure) == "InvalidInput: data source maps: b.zip would be where another file is"
    assert not list((cache(tmp_path) / "mounts").iterdir())


def _version(kind: ApplicationKind, reference: str, number: str | None) -> Version:
    return Version(kind=kind, name=reference, number=1, digest="a" * 64, size_bytes=1, created_at_s=0.0)


def _section(*sources: list[DataSourceConfig]) -> SimulationBatch:
    use: dict[str, Any] = {"application": "mine", "launchConfig": {"packageName": "p", "launchFile": "f"}}
    entries = [
        {
            "maxJobDurationInSeconds": 60,
            "robotApplications": [use],
            "simulationApplications": [use],
            "dataSources": [each.model_dump(exclude_none=True) for each in own] or None,
        }
        for own in sources
    ]
    return SimulationBatch.model_validate({"createSimulationJobRequests": entries})


def _planned(store: Store, *sources: list[DataSourceConfig]) -> BatchPlan:
    """Returns a plan with a request for each list of data sources, in one world."""
    digest = put_world(store, "g/w0")

    def find(config: DataSourceConfig) -> PinnedSource:
        from tasks.storage.base.local_files import cache_folder  # noqa: PLC0415 - follows the test's environment

        return pin_source(store, cache_folder() / "data", config)

    return plan_batch(_section(*sources), ["g/w0"], {"g/w0": digest}, _version, find)


def _reading(part: ChunkPart) -> list[EpisodeResult]:
    """Simulates episodes that read their map, where they have one."""
    for each in part.chunk.requests:
        folder = each.environment.get("DATA_SOURCE_MAPS")
        assert folder is None or (Path(folder) / "maps/one.yaml").read_bytes() == ONE
    return [passed(each.index) for each in part.chunk.requests]


def _rows_of_chunk(store: Store, batch: str, number: int, count: int) -> list[EpisodeResult]:
    rows = committed_chunk(store, batch, number) or []
    assert len(rows) == count
    return rows


def test_only_the_requests_that_need_a_missing_file_fail(file_store: Store, bucket: Store):
    made = _planned(file_store, [source("maps/one.yaml")], [source("maps/lost.yaml")], [])
    batch = begun(file_store, made)
    rows: dict[int, EpisodeResult] = {}
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, _reading, lanes=16, left_s=3600.0)
        rows |= {row.index: row for row in committed_chunk(file_store, batch.id, number) or ()}
    assert [rows[index].failure_code for index in range(3)] == ["", "InvalidS3Resource", ""]
    assert "maps-bucket" in rows[1].failure_reason
    assert "maps/lost.yaml" in rows[1].failure_reason


def test_episodes_that_read_different_content_never_share_a_chunk(file_store: Store, bucket: Store):
    one, other, same = (
        _planned(file_store, [source(key)]) for key in ("maps/one.yaml", "mapsakes.txt", "maps/one.yaml")
    )
    assert one.data_sources.keys() == same.data_sources.keys() != other.data_sources.keys()
    both = _planned(file_store, [source("maps/one.yaml")], [source("mapsakes.txt")], [source("maps/one.yaml")])
    layout = begun(file_store, both).layout
    assert (layout.chunks, layout.chunk_of(0), layout.chunk_of(2)) == (2, 0, 0)


def _forgotten(tmp_path: Path) -> None:
    (tmp_path / "cache").rename(tmp_path / "cache-of-another-machine")


@pytest.mark.parametrize(("body", "code"), [(ONE, ""), (b"changed", "MismatchedEtag"), (None, "InvalidS3Resource")])
def test_on_another_machine_the_pinned_content_is_fetched_again_or_the_row_says_why_not(
    file_store: Store, bucket: Store, tmp_path: Path, body: bytes | None, code: str
):
    batch = begun(file_store, _planned(file_store, [source("maps/one.yaml")]))
    _forgotten(tmp_path)
    bucket.put("maps/one.yaml", body) if body is not None else bucket.delete("maps/one.yaml")
    run_chunk(batch, 0, _reading, lanes=16, left_s=3600.0)
    assert [row.failure_code for row in committed_chunk(file_store, batch.id, 0) or ()] == [code]


def test_names_that_would_share_a_variable_are_a_fault_of_the_document(file_store: Store, bucket: Store):
    with pytest.raises(DocumentError, match=r"createSimulationJobRequests\[0\]\.dataSources: DATA_SOURCE_A_B"):
        _planned(file_store, [source("k", name="a-b"), source("k", name="A_b")])


CONTENT = b"walls: []\n"
ASKED = DataSourceConfig.model_validate({"name": "maps", "s3Bucket": "maps-bucket", "s3Keys": ["one.yaml"]})


@pytest.fixture
def map_bucket(file_store: Store) -> Store:
    """A bucket with a map."""
    found = open_bucket(file_store, "maps-bucket")
    found.put("one.yaml", CONTENT)
    return found


def mounted_anew(store: Store, cache: Path) -> Path:
    """Returns the folder of the map, planned and mounted as a new batch does."""
    source = pin_source(store, cache, ASKED)
    made = plan(store, templates=(template(environment={"DATA_SOURCE_MAPS": f"{DATA_PREFIX}{source.digest}"}),))
    request = Layout(made).request(0)
    mounts = Mounts(store, {source.digest: source}, cache)
    assert mounts.failure(request) is None
    return Path(mounts.resolved(request).environment["DATA_SOURCE_MAPS"])


def overwrite(file: Path, content: bytes) -> None:
    """Writes into a read-only file in place, as root may, and gives it back the time that it had."""
    before = file.stat()
    if os.geteuid() != 0:
        file.chmod(0o644)
    with file.open("r+b") as writer:
        writer.write(content)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    file.chmod(0o444)


def test_a_write_into_a_mount_reaches_neither_the_cache_nor_the_next_batch(
    file_store: Store, map_bucket: Store, tmp_path: Path
):
    overwrite(mounted_anew(file_store, tmp_path) / "one.yaml", CONTENT[::-1])
    assert [path.read_bytes() for path in (tmp_path / "objects").iterdir()] == [CONTENT]
    assert (mounted_anew(file_store, tmp_path) / "one.yaml").read_bytes() == CONTENT


def test_a_file_put_into_a_mount_is_not_there_for_the_next_batch(file_store: Store, map_bucket: Store, tmp_path: Path):
    folder = mounted_anew(file_store, tmp_path)
    folder.chmod(0o755)
    (folder / "stranger").touch()
    assert [path.name for path in mounted_anew(file_store, tmp_path).iterdir()] == ["one.yaml"]


def test_a_mount_that_nobody_wrote_into_is_used_again(file_store: Store, map_bucket: Store, tmp_path: Path):
    before = (mounted_anew(file_store, tmp_path) / "one.yaml").stat()
    assert (mounted_anew(file_store, tmp_path) / "one.yaml").stat().st_ino == before.st_ino
    assert len(list((tmp_path / "mounts").iterdir())) == 1
