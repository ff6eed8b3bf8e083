"""Lists say what is there after a gc, and after one that was killed."""

from pathlib import Path

import pytest

from tasks.housekeeping.job import Ages
from tasks.storage.base.keys import job_key, line_marks_prefix, lines_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.index_segments import Line, mark_of, read_root, read_segment
from tasks.storage.jobs.job_index import JobLines
from tasks.storage.jobs.records import JobRecord, records
from tests.housekeeping.yard import NOW, Yard, freed, later

_KIND = "world-export-job"
_FORGET = Ages(grace_s=0.0, ended_s=0.0)


def line_of(_store: Store, record: JobRecord) -> Line:
    """Returns the line of an export job."""
    return Line(mark_of(record.created_at_s, record.id), {}, {}, {})


def listed(store: Store) -> list[str]:
    """Returns the jobs that a list finds, settled."""
    lines = JobLines(store, _KIND, line_of)
    found = [each.mark.id for each in lines.found()]
    lines.settle(at_least=1)
    return found


def lines_in(store: Store) -> list[str]:
    """Returns the jobs that have a line."""
    root = read_root(store, _KIND)[0]
    return [line.mark.id for note in root.segments for line in read_segment(store, _KIND, note.name)]


def exported(yard: Yard, count: int) -> list[str]:
    """Returns the ids of export jobs that have ended, oldest first."""
    generation = yard.generation("worlds").id
    return [yard.export(f"export-{number}", generation).id for number in range(count)]


@pytest.fixture
def yard(store: Store) -> Yard:
    """A store of each kind in turn."""
    return Yard(store)


@pytest.fixture
def file_yard(file_store: Store) -> Yard:
    """A store in a folder."""
    return Yard(file_store)


def test_the_lines_of_forgotten_jobs_go_with_their_records(yard: Yard, tmp_path: Path) -> None:
    jobs = exported(yard, 3)
    assert listed(yard.store) == jobs
    Yard(later(yard.store, 60.0)).gc(tmp_path, _FORGET)
    assert (records(yard.store, _KIND), listed(yard.store), lines_in(yard.store)) == ([], [], [])
    assert yard.store.keys(line_marks_prefix(_KIND)) == []


def test_the_mark_of_a_job_that_was_never_made_goes(file_yard: Yard, tmp_path: Path) -> None:
    (job,) = exported(file_yard, 1)
    file_yard.store.delete(job_key(_KIND, job))
    assert listed(file_yard.store) == []
    file_yard.gc(tmp_path)
    assert file_yard.store.keys(line_marks_prefix(_KIND)) == []


def test_segments_that_no_root_names_go(file_yard: Yard, tmp_path: Path) -> None:
    exported(file_yard, 1)
    listed(file_yard.store)
    left = f"{lines_prefix(_KIND)}/segments/{'0' * 32}.json"
    file_yard.store.put(left, b"[]")
    assert freed(file_yard.gc(tmp_path, NOW)) == {"lines of jobs": 1}
    assert (file_yard.store.exists(left), len(lines_in(file_yard.store))) == (False, 1)


def test_gc_makes_good_what_an_older_version_has_written_since(file_yard: Yard, tmp_path: Path) -> None:
    jobs = exported(file_yard, 2)
    listed(file_yard.store)
    jobs += exported_again(file_yard)
    for key in file_yard.store.keys(line_marks_prefix(_KIND)):
        file_yard.store.delete(key)
    file_yard.store.delete(job_key(_KIND, jobs[0]))
    file_yard.gc(tmp_path)
    assert listed(file_yard.store) == jobs[1:]


def exported_again(yard: Yard) -> list[str]:
    """Returns the id of one more job."""
    return [yard.export("export-again", yard.generation("worlds").id).id]
