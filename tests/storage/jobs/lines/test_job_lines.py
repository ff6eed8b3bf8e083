"""Lists of jobs say what the records say, whatever happened to the lines that are kept of them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import cast
from uuid import uuid4

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from specs.errors import StoreAccessDenied
from specs.job_kinds import JobKind
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.keys import job_key, line_root_key, line_segment_key, lines_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs import index_segments, job_index
from tasks.storage.jobs.index_segments import (
    Line,
    Mark,
    mark_of,
    mark_open,
    open_marks,
    read_root,
    remove_lines,
    unmark,
)
from tasks.storage.jobs.job_index import START, JobLines
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, records, submit
from tasks.storage.store_url import open_store

_KIND = "world-export-job"


def line_of(_store: Store, record: JobRecord) -> Line:
    """Returns the line of an export job."""
    return Line(mark_of(record.created_at_s, record.id), {"status": (record.status,)}, {"arn": record.arn}, {})


def listed(store: Store, first: Mark = START, wanted: Mapping[str, tuple[str, ...]] | None = None) -> dict[str, str]:
    """Returns the status of each job that a list finds, in its order, having settled what has ended."""
    lines = JobLines(store, _KIND, line_of)
    found: dict[str, str] = {}
    for each in lines.found(first, wanted):
        assert each.mark.id not in found
        found[each.mark.id] = each.line.values["status"][0] if each.line else each.record.status if each.record else ""
    lines.settle(at_least=1)
    return found


def recorded(store: Store) -> dict[str, str]:
    """Returns the status of each job by its record, oldest first."""
    return {record.id: record.status for record in records(store, _KIND)}


def ended(store: Store, token: str, status: str = "Completed") -> JobRecord:
    """Returns a job that has ended."""
    return advance(store, _KIND, submit(store, _KIND, {"worlds": []}, token).id, status)


def test_what_has_ended_is_read_from_its_line_the_next_time(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [ended(store, f"t{number}") for number in range(3)]
    going = submit(store, _KIND, {"worlds": []}, "going")
    assert listed(store) == recorded(store)
    assert open_marks(store, _KIND) == [mark_of(going.created_at_s, going.id)]
    monkeypatch.setattr(JobLines, "_record", lambda _, job: going if job == going.id else pytest.fail(job))
    assert list(listed(store)) == [*(job.id for job in jobs), going.id]


def test_what_somebody_settles_while_a_list_begins_is_not_missed(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = ended(file_store, "t")
    listed(file_store)
    later = ended(file_store, "later")

    def settled_before(store: Store, kind: JobKind) -> list[Mark]:
        monkeypatch.undo()
        listed(store)
        return open_marks(store, kind)

    monkeypatch.setattr(job_index, "open_marks", settled_before)
    assert list(listed(file_store)) == [job.id, later.id]


def test_only_segments_that_the_root_names_are_left(file_store: Store) -> None:
    for number in range(3):
        ended(file_store, f"t{number}")
        listed(file_store)
    remove_lines(file_store, _KIND, frozenset({next(iter(recorded(file_store)))}))
    named = {line_segment_key(_KIND, note.name) for note in read_root(file_store, _KIND)[0].segments}
    assert set(file_store.keys(lines_prefix(_KIND))) - {line_root_key(_KIND)} == named


def test_a_line_without_a_value_is_found_whatever_is_wanted(file_store: Store) -> None:
    lines = [
        Line(Mark(number, f"j{number}"), {} if number == 1 else {"team": ("arms",)}, {}, {}) for number in (1, 0, 2)
    ]
    root = index_segments.with_lines(file_store, _KIND, read_root(file_store, _KIND)[0], lines).root
    assert [note.values for note in root.segments] == [{}]
    of_team = index_segments.with_lines(file_store, _KIND, read_root(file_store, _KIND)[0], lines[1:]).root
    assert [note.values for note in of_team.segments] == [{"team": ("arms",)}]


def test_a_list_begins_at_any_place(file_store: Store) -> None:
    marks = [mark_of(each.created_at_s, each.id) for each in (ended(file_store, f"t{number}") for number in range(5))]
    assert list(listed(file_store, marks[2])) == [mark.id for mark in marks[2:]]
    assert list(listed(file_store, marks[2])) == [mark.id for mark in marks[2:]]
    assert list(listed(file_store, Mark(marks[2].created_us, marks[2].id + "0"))) == [mark.id for mark in marks[3:]]


def test_a_store_of_an_older_version_gets_its_lines_when_it_is_listed_first(store: Store) -> None:
    for number in range(3):
        ended(store, f"t{number}")
    submit(store, _KIND, {"worlds": []}, "going")
    forget_lines(store)
    assert listed(store) == recorded(store)
    assert (read_root(store, _KIND)[0].filled, len(open_marks(store, _KIND))) == (True, 1)
    assert listed(store) == recorded(store)


def test_lines_are_filled_in_from_where_a_killed_process_left_them(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_index, "_FILLED_AT_ONCE", 2)
    jobs = [ended(file_store, f"t{number}") for number in range(5)]
    forget_lines(file_store)

    def dies_at(place: int, read: list[str]) -> None:
        def line_or_death(store: Store, record: JobRecord) -> Line:
            read.append(record.id)
            if len(read) > place:
                raise KeyboardInterrupt
            return line_of(store, record)

        list(JobLines(file_store, _KIND, line_or_death).found())

    with pytest.raises(KeyboardInterrupt):
        dies_at(3, [])
    left = list[str]()
    dies_at(9, left)
    assert len(left) == 3
    assert list(listed(file_store)) == [job.id for job in jobs]


def test_a_store_that_may_only_be_read_is_listed(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(3):
        ended(file_store, f"t{number}")
    submit(file_store, _KIND, {"worlds": []}, "going")
    for change in (lambda: None, lambda: forget_lines(file_store)):
        change()
        with monkeypatch.context() as patch:
            for name in ("put", "create", "replace", "delete"):
                patch.setattr(LocalStore, name, _refuse)
            assert listed(file_store) == recorded(file_store)


def _refuse(*_: object) -> None:
    raise StoreAccessDenied("read-only")


def test_damaged_lines_are_made_anew_from_the_records(store: Store) -> None:
    for number in range(3):
        ended(store, f"t{number}")
    for damage in (b"{}x", b"[[1]]", None):
        listed(store)
        index_segments.read_segment.cache_clear()
        for note in read_root(store, _KIND)[0].segments:
            if damage is None:
                store.delete(line_segment_key(_KIND, note.name))
            else:
                store.put(line_segment_key(_KIND, note.name), damage)
        assert listed(store) == recorded(store)
        store.put(line_root_key(_KIND), b"no root")
        assert listed(store) == recorded(store)


def test_segments_are_cut_and_only_those_are_read_that_may_hold_what_is_wanted(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(index_segments, "SEGMENT_BYTES", 400)
    for number in range(20):
        ended(file_store, f"t{number}", "Failed" if number == 7 else "Completed")
        if number % 3 == 0:
            listed(file_store)
    assert listed(file_store) == recorded(file_store)
    root = read_root(file_store, _KIND)[0]
    assert len(root.segments) > 4
    assert sum("Failed" in note.values["status"] for note in root.segments) == 1
    found = listed(file_store, wanted={"status": ("Failed",)})
    assert ("Failed" in found.values(), len(found) < 6) == (True, True)


def test_the_job_of_who_was_slower_leaves_no_second_mark(file_store: Store) -> None:
    record = submit(file_store, _KIND, {"worlds": []}, "t")
    mark_open(file_store, _KIND, Mark(7, record.id))
    assert listed(file_store) == {record.id: "Pending"}
    assert open_marks(file_store, _KIND) == [mark_of(record.created_at_s, record.id)]


def test_who_is_replaced_while_it_lists_goes_on_with_what_is_there(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(index_segments, "SEGMENT_BYTES", 400)
    for number in range(8):
        ended(file_store, f"t{number}")
    listed(file_store)
    walk = JobLines(file_store, _KIND, line_of).found()
    first = next(walk).mark.id
    ended(file_store, "late")
    index_segments.read_segment.cache_clear()
    remove_lines(file_store, _KIND, frozenset({"nobody"}))
    for note in read_root(file_store, _KIND)[0].segments:
        _rewrite(file_store, note.name)
    assert [first, *(each.mark.id for each in walk)] == list(recorded(file_store))


def _rewrite(store: Store, name: str) -> None:
    base = read_root(store, _KIND)
    change = index_segments.with_lines(store, _KIND, base[0], index_segments.read_segment(store, _KIND, name)[:1])
    assert index_segments.swap_root(store, _KIND, base, change.root)
    index_segments.remove_segments(store, _KIND, change.replaced)
    index_segments.read_segment.cache_clear()


def forget_lines(store: Store) -> None:
    """Leaves a store as an older version wrote it."""
    for key in store.keys(lines_prefix(_KIND)):
        store.delete(key)


class _KilledError(Exception):
    """Stands for a kill -9 between two writes."""


class Mortal:
    """A store whose process dies before the write after so many."""

    def __init__(self, below: Store, writes: int, death: type[Exception] = _KilledError) -> None:
        self._below, self._left, self._death, self.url = below, writes, death, below.url

    def __getattr__(self, name: str) -> object:
        if name in {"put", "create", "replace", "delete"}:
            if self._left == 0:
                raise self._death(name)
            self._left -= 1
        return getattr(self._below, name)


def _remove(store: Store, record: JobRecord) -> None:
    """Removes a record as gc does."""
    mark = mark_of(record.created_at_s, record.id)
    mark_open(store, _KIND, mark)
    store.delete(job_key(_KIND, record.id))
    remove_lines(store, _KIND, frozenset({record.id}))
    unmark(store, _KIND, mark)


@pytest.mark.parametrize("writes", range(8))
def test_a_removal_that_was_killed_anywhere_shows_no_job_that_is_gone(file_store: Store, writes: int) -> None:
    record = ended(file_store, "removed")
    ended(file_store, "stays")
    listed(file_store)
    with suppress(_KilledError):
        _remove(cast("Store", Mortal(file_store, writes)), record)
    assert listed(file_store) == recorded(file_store)
    assert listed(file_store) == recorded(file_store)


class KilledAnywhere(RuleBasedStateMachine):
    """Jobs are made, go on, end and are removed by processes that are killed between any two writes."""

    def place(self) -> str:
        raise NotImplementedError

    @initialize()
    def open(self) -> None:
        self.store = open_store(self.place())

    @rule(writes=st.integers(0, 5), token=st.integers(0, 5))
    def submit_and_die(self, writes: int, token: int) -> None:
        self.dying(writes, lambda store: submit(store, _KIND, {"worlds": []}, f"t{token}"))

    @rule(status=st.sampled_from(["Running", "Completed", "Failed"]), which=st.integers(0, 99))
    def advance_one(self, status: str, which: int) -> None:
        if found := records(self.store, _KIND):
            advance(self.store, _KIND, found[which % len(found)].id, status)

    @rule(writes=st.integers(0, 12))
    def list_and_die(self, writes: int) -> None:
        self.dying(writes, listed)

    @rule(writes=st.integers(0, 8), which=st.integers(0, 99))
    def remove_and_die(self, writes: int, which: int) -> None:
        if found := [record for record in records(self.store, _KIND) if is_terminal(record)]:
            self.dying(writes, lambda store: _remove(store, found[which % len(found)]))

    @rule(luck=st.integers(0, 9))
    def forget(self, luck: int) -> None:
        if luck == 9:
            forget_lines(self.store)

    @invariant()
    def lists_say_what_records_say(self) -> None:
        index_segments.read_segment.cache_clear()
        reader = cast("Store", Mortal(self.store, 0, death=StoreAccessDenied))
        assert listed(reader) == recorded(self.store)

    def dying(self, writes: int, act: Callable[[Store], object]) -> None:
        with suppress(_KilledError):
            act(cast("Store", Mortal(self.store, writes)))


@pytest.mark.long
def test_any_order_of_deaths_leaves_lists_that_say_what_records_say(tmp_path: Path) -> None:
    class OnAFolder(KilledAnywhere):
        def place(self) -> str:
            return (tmp_path / uuid4().hex).as_uri()

    run_state_machine_as_test(OnAFolder, settings=settings(max_examples=60, stateful_step_count=30))


@pytest.mark.long
def test_any_order_of_deaths_leaves_right_lists_in_a_bucket(s3_url: Callable[[], str]) -> None:
    class InABucket(KilledAnywhere):
        def place(self) -> str:
            return s3_url()

    run_state_machine_as_test(InABucket, settings=settings(max_examples=5, stateful_step_count=15))
