"""What housekeeping takes for the records of a store."""

from typing import cast

from tasks.housekeeping.references import read_records, record_entries
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Entry, Store
from tests.housekeeping.yard import Meddled, Yard


def test_a_record_that_a_listing_leaves_out_is_found_by_its_key_and_one_that_is_gone_is_not(yard: Yard) -> None:
    there, gone = yard.generation("there"), yard.generation("gone")
    known = read_records(yard.store, record_entries(yard.store, {}), {})
    yard.lose(gone)
    blind = Meddled(yard.store)
    blind.instead("entries", "jobs", list[Entry])
    found = record_entries(cast("Store", blind), known)
    assert [entry.key for entry in found] == [job_key(there.kind, there.id)]
