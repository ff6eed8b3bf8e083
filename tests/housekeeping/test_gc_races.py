"""Two processes that collect garbage over and over, while others make, name and delete; on a folder and on a server."""

import logging
from collections import Counter
from pathlib import Path

import pytest

from tasks.housekeeping.machine import remove_entry, unused_entries
from tasks.storage.base.store import Store
from tests.housekeeping.racers import race_cache, race_gc
from tests.housekeeping.yard import Yard, freed
from tests.servers.racers import in_processes

_LOG = logging.getLogger(__name__)
pytestmark = pytest.mark.long  # `test_races` steps from one write to the next whenever tests are run


@pytest.mark.parametrize(("lives", "seconds"), [(2, 1.0), pytest.param(6, 20.0, marks=pytest.mark.soak)])
def test_nothing_goes_that_a_record_names_while_two_gcs_run_over_and_over(
    store: Store, tmp_path: Path, lives: int, seconds: float
) -> None:
    grace_s = 4.0 if store.url.startswith("s3:") else 2.0  # a server tells times in whole seconds
    roles = ["gc ahead", "gc behind", *(f"life{number}" for number in range(lives))]
    told = in_processes(race_gc, [(store.url, role, seconds, grace_s) for role in roles])
    yard = Yard(store)
    told[0].freed.update(freed(yard.gc(tmp_path)))
    there = set(store.keys(""))
    late = {key for each in told for key in each.late}
    needs = {key: needs for each in told for key, needs in each.needs.items() if key in there - late}
    made, gcs = sum(each.operations for each in told[2:]), sum(each.operations for each in told[:2])
    gone = sum((each.freed for each in told), Counter[str]())
    _LOG.info(
        "%s: %d made, %d records, %d late, %d gcs freed %s", store.url[:4], made, len(needs), len(late), gcs, gone
    )
    assert {key: needed - there for key, needed in needs.items() if needed - there} == {}
    assert gone.total() > 0
    yard.gc(tmp_path)
    assert freed(yard.gc(tmp_path)) == {}


@pytest.mark.parametrize(("fillers", "seconds"), [(2, 0.8), pytest.param(4, 20.0, marks=pytest.mark.soak)])
def test_two_gcs_clear_a_cache_at_once_while_others_fill_it(tmp_path: Path, fillers: int, seconds: float) -> None:
    for folder in ("bundles", "timings"):
        (tmp_path / folder).mkdir()
    roles = ["gc", "gc", *(f"fill{number}" for number in range(fillers))]
    told = sum(in_processes(race_cache, [(str(tmp_path), role, seconds) for role in roles]), Counter[str]())
    _LOG.info("cache: %s", told)
    assert (told["older"], told["made"] > 0, told["went"] > 0) == (0, True, True)
    entries = unused_entries(tmp_path, 0.0)
    assert all(remove_entry(entry) for entry in entries)
    assert unused_entries(tmp_path, 0.0) == []
