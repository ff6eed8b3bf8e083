"""Up to eight processes add versions to the same applications, on a folder and a real S3 server."""

import logging

import pytest

from tasks.applications.versions import read_application
from tasks.storage.base.store import Store
from tests.servers.racers import in_processes
from tests.servers.swap_racers import add_versions_for

_LOG = logging.getLogger(__name__)


@pytest.mark.parametrize(("processes", "seconds"), [(3, 1.0), pytest.param(8, 10.0, marks=pytest.mark.long)])
def test_every_version_that_was_acknowledged_has_a_number_of_its_own_and_none_is_left_out(
    store: Store, processes: int, seconds: float
) -> None:
    names = ["courier", "guide"]
    told = in_processes(add_versions_for, [(store.url, f"p{each}", names, seconds) for each in range(processes)])
    assert [wrong for each in told for wrong in each.wrong] == []
    done = [done.split() for each in told for done in each.done]
    _LOG.info("versions, %s: %d acknowledged", store.url[:4], len(done))
    for name in names:
        numbers = sorted(int(number) for application, number in done if application == name)
        found = read_application(store, "robot-application", name)
        assert numbers == list(range(1, (found.last_number if found else 0) + 1))
