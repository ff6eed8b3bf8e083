"""Lists of jobs say what the records say, whatever is in the table that is kept of them."""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from uuid import uuid4

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test

from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store, StoredObject
from tasks.storage.jobs import job_index
from tasks.storage.jobs.job_index import START, FoundJob, IndexEntry, JobIndex, JobPlace, place_of, records_under_way
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, records, submit
from tasks.storage.store_url import open_store

_KIND = "world-export-job"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of its own, where a table is kept of the first job on."""
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(job_index, "_KEPT_FROM", 1)
    return tmp_path / "cache"


def entry_of(_store: Store, record: JobRecord) -> IndexEntry:
    """Returns the entry of an export job."""
    return IndexEntry(place_of(record.created_at_s, record.id), {"status": (record.status,)}, {"arn": record.arn}, {})


def listed(
    store: Store, first: JobPlace = START, wanted: Mapping[str, tuple[str, ...]] | None = None
) -> dict[str, str]:
    """Returns the status of each job that a list finds, in its order."""
    return {each.place.id: _status(each) for each in JobIndex(store, _KIND, entry_of).jobs(first, wanted)}


def _status(found: FoundJob) -> str:
    return found.entry.values["status"][0] if found.entry else found.record.status if found.record else ""


def recorded(store: Store) -> dict[str, str]:
    """Returns the status of each job by its record, oldest first."""
    return {record.id: record.status for record in records(store, _KIND)}


def ended(store: Store, token: str, status: str = "Completed") -> JobRecord:
    """Returns a job that has ended."""
    return advance(store, _KIND, submit(store, _KIND, {"worlds": []}, token).id, status)


@pytest.fixture
def reads(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The keys of the job records that are read."""
    keys: list[str] = []
    get = type(file_store).get

    def noted(store: Store, key: str, *more: int) -> StoredObject:
        keys.extend([key] if key.startswith("jobs/") else [])
        return get(store, key, *more)

    monkeypatch.setattr(type(file_store), "get", noted)
    return keys


def test_the_record_of_a_job_that_has_ended_is_read_once(file_store: Store, reads: list[str]) -> None:
    jobs = [ended(file_store, f"t{number}") for number in range(3)]
    going = submit(file_store, _KIND, {"worlds": []}, "going")
    assert listed(file_store) == recorded(file_store)
    reads.clear()
    assert list(listed(file_store)) == [*(job.id for job in jobs), going.id]
    assert reads == [job_key(_KIND, going.id)]


def test_few_jobs_leave_no_table_behind(file_store: Store, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_index, "_KEPT_FROM", 8)
    ended(file_store, "t")
    assert listed(file_store) == recorded(file_store)
    assert not (cache / "lists").exists()


def test_an_entry_that_took_long_to_make_is_kept_of_a_single_job(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_index, "_KEPT_FROM", 8)
    ended(file_store, "t")
    made: list[str] = []

    def detailed(store: Store, record: JobRecord) -> IndexEntry:
        made.append(record.id)
        return entry_of(store, record)._replace(detail={"jobs": [record.id]})

    found = [list(JobIndex(file_store, _KIND, detailed).jobs()) for _ in range(3)]
    assert [each.entry.detail for few in found for each in few if each.entry] == [{"jobs": made}] * 3
    assert len(made) == 1


def test_a_list_begins_at_any_place(file_store: Store) -> None:
    places = [place_of(job.created_at_s, job.id) for job in (ended(file_store, f"t{number}") for number in range(5))]
    for _ in range(2):  # by the records, and by the table
        assert list(listed(file_store, places[2])) == [place.id for place in places[2:]]
    after = JobPlace(places[2].created_us, places[2].id + "0")
    assert list(listed(file_store, after)) == [place.id for place in places[3:]]


def test_what_is_certainly_not_wanted_is_left_out_of_the_table_and_what_lacks_the_name_is_not(
    file_store: Store,
) -> None:
    for number in range(4):
        ended(file_store, f"t{number}", "Failed" if number == 2 else "Completed")
    listed(file_store)
    assert list(listed(file_store, wanted={"status": ("Failed",)}).values()) == ["Failed"]
    assert listed(file_store, wanted={"team": ("arms",)}) == recorded(file_store)


def test_a_job_that_is_removed_and_made_again_is_the_new_one(file_store: Store) -> None:
    job = ended(file_store, "t").id
    assert listed(file_store) == {job: "Completed"}
    file_store.delete(job_key(_KIND, job))
    submit(file_store, _KIND, {"worlds": []}, "t")
    assert listed(file_store) == {job: "Pending"}
    advance(file_store, _KIND, job, "Failed")
    assert listed(file_store) == {job: "Failed"}
    file_store.delete(job_key(_KIND, job))
    assert listed(file_store) == {}


@pytest.mark.parametrize("damage", [b"no table", b"", None])
def test_a_damaged_table_is_made_anew(file_store: Store, cache: Path, damage: bytes | None) -> None:
    for number in range(3):
        ended(file_store, f"t{number}")
    listed(file_store)
    (table,) = (cache / "lists").iterdir()
    whole = table.read_bytes()
    table.write_bytes(whole[: len(whole) // 2] + b"\xff" * 100 if damage is None else damage)
    for _ in range(2):
        assert listed(file_store) == recorded(file_store)
    assert table.read_bytes().startswith(b"SQLite format 3")


def test_where_no_table_can_be_kept_the_records_are_read(file_store: Store, cache: Path) -> None:
    ended(file_store, "t")
    cache.write_text("no folder")
    for _ in range(2):
        assert listed(file_store) == recorded(file_store)


def test_nobody_but_the_owner_reads_the_table(file_store: Store, cache: Path) -> None:
    ended(file_store, "t")
    listed(file_store)
    (table,) = (cache / "lists").iterdir()
    assert (table.parent.stat().st_mode & 0o77, table.stat().st_mode & 0o77) == (0, 0)


def test_a_record_of_a_stranger_is_left_out_and_named(file_store: Store, caplog: pytest.LogCaptureFixture) -> None:
    job = ended(file_store, "t")
    file_store.put(job_key(_KIND, "wej-0123456789abcdef"), b"{}")
    with caplog.at_level(logging.WARNING):
        assert list(listed(file_store)) == [job.id]
        assert list(listed(file_store)) == [job.id]
    assert caplog.text.count("wej-0123456789abcdef is left out of lists") == 1


def test_jobs_under_way_are_found_without_the_records_of_the_others(file_store: Store, reads: list[str]) -> None:
    for number in range(3):
        ended(file_store, f"t{number}")
    going = [submit(file_store, _KIND, {"worlds": []}, f"going{number}").id for number in range(2)]
    assert [record.id for record in records_under_way(file_store, _KIND)] == going
    reads.clear()
    assert [record.id for record in records_under_way(file_store, _KIND)] == going
    assert sorted(reads) == sorted(job_key(_KIND, job) for job in going)


class AnyOrder(RuleBasedStateMachine):
    """Jobs are made, go on, end and are removed, and lists on two machines see each of it sooner or later."""

    folder: Path
    move: Callable[[Path], None]

    @initialize()
    def open(self) -> None:
        self.own = self.folder / uuid4().hex
        self.store = open_store((self.own / "store").as_uri())

    @rule(token=st.integers(0, 5))
    def submit(self, token: int) -> None:
        submit(self.store, _KIND, {"worlds": []}, f"t{token}")

    @rule(status=st.sampled_from(["Running", "Completed", "Failed"]), which=st.integers(0, 99))
    def advance(self, status: str, which: int) -> None:
        if found := records(self.store, _KIND):
            advance(self.store, _KIND, found[which % len(found)].id, status)

    @rule(which=st.integers(0, 99))
    def remove(self, which: int) -> None:
        if found := [record for record in records(self.store, _KIND) if is_terminal(record)]:
            self.store.delete(job_key(_KIND, found[which % len(found)].id))

    @rule(machine=st.sampled_from(["one", "other"]))
    def list_on_a_machine(self, machine: str) -> None:
        type(self).move(self.own / machine)
        assert listed(self.store) == recorded(self.store)


def test_lists_say_what_records_say_in_any_order_of_events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Here(AnyOrder):
        folder = tmp_path
        move = staticmethod(lambda cache: monkeypatch.setenv("SIMYARD_CACHE", str(cache)))

    run_state_machine_as_test(Here, settings=settings(max_examples=15, stateful_step_count=20))
