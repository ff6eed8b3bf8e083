"""What workers make of worlds for an export job: the zip of one machine, to the byte, and nothing left over."""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import pytest

from specs.pipeline.world_sections import WorldFormat
from tasks.export.job.export_job import run_export_job
from tasks.export.job.world_files import (
    WorldFiles,
    drop_parts,
    keep_part,
    kept_part,
    kept_parts,
    make_parts,
    world_files,
)
from tasks.storage.base.keys import export_part_key, export_parts_prefix
from tasks.storage.base.store import Store
from tests.export.export_jobs import GENERATION, TOKEN, WORLDS, cancel, request, run, store_of_worlds

FORMATS: tuple[WorldFormat, ...] = ("mjcf", "svg")
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
        formats=FORMATS,
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

    record = run_export_job(store, request(), formats=FORMATS, token=TOKEN, progress=lambda *_: None, elsewhere=written)
    assert record.status == "Completed"


def test_a_canceled_job_leaves_nothing_that_workers_made(store: Store) -> None:
    def canceled(job: str, references: Sequence[str], formats: Collection[WorldFormat], **told: object) -> None:
        make_parts(store, job, references, formats, lambda: True)
        cancel(store)

    record = run_export_job(
        store, request(), formats=FORMATS, token=TOKEN, progress=lambda *_: None, elsewhere=canceled
    )
    assert record.status == "Canceled"
    assert store.keys(export_parts_prefix(record.id)) == []


def test_a_world_that_cannot_be_read_is_left_to_the_job_which_fails_with_its_code(store: Store) -> None:
    store.delete(f"worlds/{REFERENCES[0]}.json")
    make_parts(store, JOB, REFERENCES, FORMATS, lambda: True)
    assert kept_parts(store, JOB) == {REFERENCES[1]}
    record = run_export_job(
        store, request(), formats=FORMATS, token=TOKEN, progress=lambda *_: None, elsewhere=Elsewhere(store)
    )
    assert (record.status, record.failure_code) == ("Failed", "ResourceNotFound")


def test_nothing_more_is_written_once_nobody_wants_it(store: Store) -> None:
    wanted = iter([True, False])
    make_parts(store, JOB, REFERENCES, FORMATS, lambda: next(wanted))
    assert kept_parts(store, JOB) == {REFERENCES[0]}


def test_what_was_kept_comes_back_in_its_order(store: Store) -> None:
    made = world_files(WORLDS[0], FORMATS)
    keep_part(store, JOB, made)
    kept = kept_part(store, JOB, REFERENCES[0])
    assert kept == WorldFiles(GENERATION, WORLDS[0].name, made.files)
    assert kept
    assert [*kept.files] == [*made.files]


def test_what_does_not_unpack_counts_as_not_there(store: Store) -> None:
    keep_part(store, JOB, world_files(WORLDS[0], FORMATS))
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
