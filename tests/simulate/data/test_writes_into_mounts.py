"""What is written into a mounted data source reaches neither the cache nor the next batch."""

import os
from pathlib import Path

import pytest

from specs.data.episode import EpisodeResult
from specs.robomaker.simulation import DataSourceConfig
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.data.data_sources import DATA_PREFIX
from tasks.simulate.data.mounts import Mounts, pin_source
from tasks.simulate.plan.chunks import ProgramKey, program_key
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.planned_batches import all_pass, begun, plan, template

CONTENT = b"walls: []\n"
ASKED = DataSourceConfig.model_validate({"name": "maps", "s3Bucket": "maps-bucket", "s3Keys": ["one.yaml"]})


@pytest.fixture
def bucket(file_store: Store) -> Store:
    """A bucket with a map."""
    found = open_bucket(file_store, "maps-bucket")
    found.put("one.yaml", CONTENT)
    return found


def mounted(store: Store, cache: Path) -> Path:
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
    file_store: Store, bucket: Store, tmp_path: Path
):
    overwrite(mounted(file_store, tmp_path) / "one.yaml", CONTENT[::-1])
    assert [path.read_bytes() for path in (tmp_path / "objects").iterdir()] == [CONTENT]
    assert (mounted(file_store, tmp_path) / "one.yaml").read_bytes() == CONTENT


def test_a_file_put_into_a_mount_is_not_there_for_the_next_batch(file_store: Store, bucket: Store, tmp_path: Path):
    folder = mounted(file_store, tmp_path)
    folder.chmod(0o755)
    (folder / "stranger").touch()
    assert [path.name for path in mounted(file_store, tmp_path).iterdir()] == ["one.yaml"]


def test_a_chunk_is_timed_as_the_program_that_plans_know(
    file_store: Store, bucket: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    source = pin_source(file_store, tmp_path / "data", ASKED)
    reading = template(environment={"DATA_SOURCE_MAPS": f"{DATA_PREFIX}{source.digest}"})
    batch = begun(file_store, plan(file_store, templates=(reading,), data_sources={source.digest: source}))
    timed: list[tuple[ProgramKey, ProgramKey]] = []

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        timed.append((part.program, program_key(part.chunk.requests[0])))
        return all_pass(part)

    run_chunk(batch, 0, simulate, lanes=4, left_s=9.0)
    ((planned, resolved),) = timed
    assert planned == program_key(batch.layout.request(0)) != resolved


def test_a_mount_that_nobody_wrote_into_is_used_again(file_store: Store, bucket: Store, tmp_path: Path):
    before = (mounted(file_store, tmp_path) / "one.yaml").stat()
    assert (mounted(file_store, tmp_path) / "one.yaml").stat().st_ino == before.st_ino
    assert len(list((tmp_path / "mounts").iterdir())) == 1
