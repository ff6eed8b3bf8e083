"""What records name, and signed metadata that newer versions have replaced."""

import json
from pathlib import Path
from typing import cast

import pytest

from tasks.housekeeping.named_objects import read_records, record_entries, replaced_metadata
from tasks.storage.base.keys import job_key, trust_key
from tasks.storage.base.store import Entry, Store
from tests.housekeeping.yard import Meddled, Yard, freed


def test_a_record_that_a_listing_leaves_out_is_found_by_its_key_and_one_that_is_gone_is_not(yard: Yard) -> None:
    there, gone = yard.generation("there"), yard.generation("gone")
    known = read_records(yard.store, record_entries(yard.store, {}), {})
    yard.lose(gone)
    blind = Meddled(yard.store)
    blind.instead("entries", "jobs", list[Entry])
    found = record_entries(cast("Store", blind), known)
    assert [entry.key for entry in found] == [job_key(there.kind, there.id)]


_NEVER = float("inf")


def put(store: Store, name: str, **versions: int) -> None:
    meta = {f"{role}.json": {"version": version} for role, version in versions.items()}
    store.put(trust_key("fleet", name), json.dumps({"signed": {"meta": meta}}).encode())


@pytest.fixture
def signed(file_store: Store) -> Store:
    """A store whose newest metadata is snapshot 3, targets 1 and deployer 3; a signer was killed while it wrote 4."""
    for version in range(1, 5):
        put(file_store, f"{version}.snapshot.json", targets=1, deployer=version)
        put(file_store, f"{version}.deployer.json")
        put(file_store, f"{version}.root.json")
    put(file_store, "1.targets.json")
    put(file_store, "timestamp.json", snapshot=3)
    return file_store


def replaced(store: Store, before_s: float = _NEVER) -> list[str]:
    return sorted(Path(key).name for key in replaced_metadata(store, store.entries(""), before_s))


def test_older_versions_are_replaced_but_roots_and_what_does_not_count_yet_are_not(signed: Store) -> None:
    assert replaced(signed) == ["1.deployer.json", "1.snapshot.json", "2.deployer.json", "2.snapshot.json"]


def test_a_version_stays_for_as_long_as_the_one_in_its_place_is_young(signed: Store) -> None:
    assert replaced(signed, before_s=0.0) == []


@pytest.mark.parametrize(
    "body", [None, b"{", b"[]", b'{"signed": {"meta": {}}}', b'{"signed": {"meta": {"snapshot.json": 1}}}']
)
@pytest.mark.parametrize("name", ["timestamp.json", "3.snapshot.json"])
def test_of_a_repository_that_cannot_be_read_nothing_is_replaced(signed: Store, name: str, body: bytes | None) -> None:
    signed.delete(trust_key("fleet", name))
    if body is not None:
        signed.put(trust_key("fleet", name), body)
    assert replaced(signed) == []


def test_a_gc_removes_them(signed: Store, tmp_path: Path) -> None:
    assert freed(Yard(signed).gc(tmp_path)) == {"signed metadata": 4}
    assert replaced(signed) == []
