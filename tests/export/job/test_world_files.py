"""What workers make of worlds for an export job: the zip of one machine, to the byte, and nothing left over."""

import hashlib
import json
import zipfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import mujoco
import pytest

from specs.data.world import World
from specs.errors import DocumentError
from specs.pipeline.world_sections import FORMATS, WorldFormat
from tasks.export.job.export_job import run_export_job
from tasks.export.job.world_files import (
    MANIFEST,
    WorldFiles,
    drop_parts,
    keep_part,
    kept_part,
    kept_parts,
    make_parts,
    world_files,
    write_zip,
)
from tasks.storage.base.keys import export_part_key, export_parts_prefix
from tasks.storage.base.store import Store
from tests.export.export_jobs import GENERATION, TOKEN, WORLDS, cancel, request, run, store_of_worlds
from tests.factories.worlds import apartment

WRITTEN_FORMATS: tuple[WorldFormat, ...] = ("mjcf", "svg")
REFERENCES = [f"{GENERATION}/{world.name}" for world in WORLDS]
JOB = "wej-1"


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    return store_of_worlds(tmp_path / "store")


class Elsewhere:
    """Workers that come to the first so many of a job's worlds."""

    def __init__(self, store: Store, most: int = 2) -> None:
        self._store, self._most = store, most

    def __call__(
        self,
        job: str,
        references: Sequence[str],
        formats: Collection[WorldFormat],
        *,
        going: Callable[[], bool],
        done: Callable[[int], None],
    ) -> None:
        make_parts(self._store, job, references[: self._most], formats, going)
        done(self._most)


@pytest.mark.parametrize("most", [0, 1, 2])
def test_the_zip_is_the_same_bytes_whoever_wrote_its_worlds(tmp_path: Path, store: Store, most: int) -> None:
    own = run(store_of_worlds(tmp_path / "other"))
    seen: list[tuple[int, int]] = []
    record = run_export_job(
        store,
        request(),
        formats=WRITTEN_FORMATS,
        token=TOKEN,
        progress=lambda *at: seen.append(at),
        elsewhere=Elsewhere(store, most),
    )
    assert record.status == "Completed"
    assert record.detail["sha256"] == own.detail["sha256"]
    assert seen[0] == (most, 2)
    assert seen[-1] == (2, 2)
    assert store.keys(export_parts_prefix(record.id)) == []


def test_what_workers_made_is_not_made_again(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = Elsewhere(store)

    def written(*given: object, **named: object) -> None:
        elsewhere(*given, **named)  # pyright: ignore[reportArgumentType, reportCallIssue]
        monkeypatch.setattr("tasks.export.job.export_job.world_files", lambda *_: pytest.fail("made again"))

    record = run_export_job(
        store, request(), formats=WRITTEN_FORMATS, token=TOKEN, progress=lambda *_: None, elsewhere=written
    )
    assert record.status == "Completed"


def test_a_canceled_job_leaves_nothing_that_workers_made(store: Store) -> None:
    def canceled(job: str, references: Sequence[str], formats: Collection[WorldFormat], **told: object) -> None:
        make_parts(store, job, references, formats, lambda: True)
        cancel(store)

    record = run_export_job(
        store, request(), formats=WRITTEN_FORMATS, token=TOKEN, progress=lambda *_: None, elsewhere=canceled
    )
    assert record.status == "Canceled"
    assert store.keys(export_parts_prefix(record.id)) == []


def test_a_world_that_cannot_be_read_is_left_to_the_job_which_fails_with_its_code(store: Store) -> None:
    store.delete(f"worlds/{REFERENCES[0]}.json")
    make_parts(store, JOB, REFERENCES, WRITTEN_FORMATS, lambda: True)
    assert kept_parts(store, JOB) == {REFERENCES[1]}
    record = run_export_job(
        store, request(), formats=WRITTEN_FORMATS, token=TOKEN, progress=lambda *_: None, elsewhere=Elsewhere(store)
    )
    assert (record.status, record.failure_code) == ("Failed", "ResourceNotFound")


def test_nothing_more_is_written_once_nobody_wants_it(store: Store) -> None:
    wanted = iter([True, False])
    make_parts(store, JOB, REFERENCES, WRITTEN_FORMATS, lambda: next(wanted))
    assert kept_parts(store, JOB) == {REFERENCES[0]}


def test_what_was_kept_comes_back_in_its_order(store: Store) -> None:
    made = world_files(WORLDS[0], WRITTEN_FORMATS)
    keep_part(store, JOB, made)
    kept = kept_part(store, JOB, REFERENCES[0])
    assert kept == WorldFiles(GENERATION, WORLDS[0].name, made.files)
    assert kept
    assert [*kept.files] == [*made.files]


def test_what_does_not_unpack_counts_as_not_there(store: Store) -> None:
    keep_part(store, JOB, world_files(WORLDS[0], WRITTEN_FORMATS))
    key = export_part_key(JOB, GENERATION, WORLDS[0].name)
    whole = store.get(key).body
    store.put(key, whole[: len(whole) // 2])
    assert kept_part(store, JOB, REFERENCES[0]) is None
    assert kept_part(store, JOB, REFERENCES[1]) is None


def test_what_is_dropped_is_gone_and_other_jobs_keep_theirs(store: Store) -> None:
    for job in (JOB, "wej-2"):
        make_parts(store, job, REFERENCES, (), lambda: True)
    drop_parts(store, JOB)
    assert kept_parts(store, JOB) == set()
    assert kept_parts(store, "wej-2") == set(REFERENCES)


ZIP_WORLDS = (apartment(name="world-1-1"), apartment(name="world-1-2"))
ZIP_GENERATION = "wgj-0000000000000001"


def test_the_same_worlds_give_the_same_bytes(tmp_path: Path):
    first = write_zip(ZIP_WORLDS, FORMATS, tmp_path / "first.zip")
    second = write_zip(iter(ZIP_WORLDS), set(FORMATS), tmp_path / "second.zip")
    assert first == second == hashlib.sha256((tmp_path / "first.zip").read_bytes()).hexdigest()
    assert (tmp_path / "first.zip").read_bytes() == (tmp_path / "second.zip").read_bytes()


def test_each_format_has_a_folder_and_each_world_its_place_in_it(tmp_path: Path):
    write_zip(ZIP_WORLDS, ["svg", "map"], tmp_path / "plans.zip")
    with zipfile.ZipFile(tmp_path / "plans.zip") as bundle:
        assert bundle.namelist() == [
            f"world/{ZIP_GENERATION}/world-1-1.json",
            f"map/{ZIP_GENERATION}/world-1-1/map.pgm",
            f"map/{ZIP_GENERATION}/world-1-1/map.yaml",
            f"svg/{ZIP_GENERATION}/world-1-1.svg",
            f"world/{ZIP_GENERATION}/world-1-2.json",
            f"map/{ZIP_GENERATION}/world-1-2/map.pgm",
            f"map/{ZIP_GENERATION}/world-1-2/map.yaml",
            f"svg/{ZIP_GENERATION}/world-1-2.svg",
            MANIFEST,
        ]


def test_gazebo_finds_robomakers_workspace_with_shared_models_once(tmp_path: Path):
    write_zip(ZIP_WORLDS, ["sdf"], tmp_path / "gazebo.zip")
    with zipfile.ZipFile(tmp_path / "gazebo.zip") as bundle:
        names = [name.removeprefix("workspace_src/src/") for name in bundle.namelist() if name.startswith("workspace")]
    worlds = [name for name in names if name.endswith(".world")]
    assert worlds == [
        f"aws_robomaker_worldforge_worlds/worlds/{name}/{name}.world"
        for name in (f"generation_{ZIP_GENERATION}_world-1-1", f"generation_{ZIP_GENERATION}_world-1-2")
    ]
    models = [name for name in names if "_shared_models/models/" in name and name.endswith("model.sdf")]
    assert len(models) == len(ZIP_WORLDS[0].furniture)
    assert "aws_robomaker_worldforge_worlds/launch/world.launch" in names


def test_the_manifest_names_every_other_file_with_its_digest(tmp_path: Path):
    write_zip(ZIP_WORLDS, ["mjcf", "svg"], tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as bundle:
        listed = json.loads(bundle.read(MANIFEST))["files"]
        assert set(listed) == set(bundle.namelist()) - {MANIFEST}
        for name, facts in listed.items():
            assert hashlib.sha256(bundle.read(name)).hexdigest() == facts["sha256"]


def test_the_world_in_the_zip_is_the_world(tmp_path: Path):
    write_zip(ZIP_WORLDS, [], tmp_path / "worlds.zip")
    with zipfile.ZipFile(tmp_path / "worlds.zip") as bundle:
        assert World.model_validate_json(bundle.read(f"world/{ZIP_GENERATION}/world-1-2.json")) == ZIP_WORLDS[1]


def test_mujoco_loads_the_zip_whatever_else_is_in_it(tmp_path: Path):
    write_zip(ZIP_WORLDS[:1], FORMATS, tmp_path / "one.zip")
    with (tmp_path / "one.zip").open("rb") as bundle:
        assert mujoco.MjSpec.from_zip(bundle).compile().geom("sofa-1/seat").size[0] == 1.0


def test_a_world_whose_name_would_leave_its_folder_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match="world"):
        write_zip([apartment(name="../../etc")], [], tmp_path / "evil.zip")


def test_a_world_that_comes_twice_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="twice"):
        write_zip([ZIP_WORLDS[0], ZIP_WORLDS[0]], [], tmp_path / "twice.zip")
