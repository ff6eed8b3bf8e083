"""Stores that are full from some write on, and clocks that are set: work ends right, and with the same bytes."""

import errno
import re
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import botocore.auth
import numpy as np
import pytest
from botocore.exceptions import ClientError

from specs.errors import StoreFull, StoreUnreachable
from tasks.storage.backends import local
from tasks.storage.backends.local import LocalStore
from tasks.storage.backends.s3_client import S3Client
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ProcessIdentity, hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tests.factories.lively_claims import hold_lively_claim
from tests.integration.faults.breakable_work import Work, export, generate, results, simulate

pytestmark = pytest.mark.integration
# More writes than any of the work does, so that all are tried; each ends the loop when nothing failed.
_MOST_WRITES = 60
_DAY_S = 86_400.0


class Full:
    """Lets so many writes through, and refuses the others as a full disk does."""

    def __init__(self, writes: int) -> None:
        self._left = writes
        self.refused = 0

    def is_full(self) -> bool:
        self._left -= 1
        self.refused += self._left < 0
        return self._left < 0


@contextmanager
def full_after(writes: int, store: Store) -> Generator[Full]:
    full = Full(writes)
    flush, call = local.flush_to_disk, S3Client.call

    def flush_unless_full(file: object) -> None:
        if full.is_full():
            raise OSError(errno.ENOSPC, "No space left on device")
        flush(file)  # pyright: ignore[reportArgumentType] - the file it was given

    def call_unless_full(self: S3Client, operation: str, **parameters: object) -> object:
        if operation == "put_object" and full.is_full():
            answer = {"Error": {"Code": "QuotaExceeded"}, "ResponseMetadata": {"HTTPStatusCode": 507}}
            raise ClientError(answer, operation)  # pyright: ignore[reportArgumentType] - the parts that are read
        return call(self, operation, **parameters)

    with pytest.MonkeyPatch.context() as patch:
        if isinstance(store, LocalStore):
            patch.setattr(local, "flush_to_disk", flush_unless_full)
        else:
            patch.setattr(S3Client, "call", call_unless_full)
        yield full


def ended(work: Work, store: Store, name: str) -> JobRecord | StoreFull:
    try:
        return work(store, name)
    except StoreFull as exc:
        return exc


def broken_then_whole(work: Work, store: Store, name: str, writes: int) -> int:
    """Returns how many writes a full store refused, having done the work again after there was room."""
    with full_after(writes, store) as full:
        found = ended(work, store, name)
    if isinstance(found, StoreFull):
        assert store.url in str(found)
        with _holders_known_dead(is_dead=True):  # as the process is that the full store has ended
            assert work(store, name).status == "Completed"
    elif found.status == "Failed":
        assert found.failure_code == "LimitExceeded"
        assert re.search(r"MiB free|no room", found.failure_reason)
    else:  # all that was refused was to release the claim
        assert (found.status, full.refused) in {("Completed", 0), ("Completed", 1)}
    return full.refused


@contextmanager
def _holders_known_dead(*, is_dead: bool) -> Generator[None]:
    """What looks at claims inside the block knows that their holders are dead; or not, as of another machine's."""

    def answer(_process: ProcessIdentity) -> bool:
        return is_dead

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tasks.storage.jobs.claim.is_known_dead", answer)
        yield


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.soak)])
@pytest.mark.parametrize("work", [simulate, generate, export])
def test_work_that_a_full_folder_ends_at_any_write_goes_on_where_it_was(work: Work, step: int, tmp_path: Path) -> None:
    quiet = open_store((tmp_path / "quiet").as_uri())
    assert work(quiet, "tok").status == "Completed"
    for writes in range(0, _MOST_WRITES, step):
        store = open_store((tmp_path / f"full-{writes}").as_uri())
        refused = broken_then_whole(work, store, "tok", writes)
        assert not list((tmp_path / f"full-{writes}").rglob(".tmp-*"))
        if not refused:
            assert writes > 3
            return
        if work is not export:  # an export that Failed stays so: its next run is another job
            assert results(store) == results(quiet)
    pytest.fail("there is always one write more")


@pytest.mark.long
@pytest.mark.parametrize("tried", [(5,), pytest.param((0, 2, 7, 9, 11, 14), marks=pytest.mark.soak)])
@pytest.mark.parametrize("work", [simulate, generate])
def test_work_that_a_full_bucket_ends_goes_on_where_it_was(
    work: Work, tried: tuple[int, ...], s3_url: Callable[[], str]
) -> None:
    quiet = open_store(s3_url())
    assert work(quiet, "tok").status == "Completed"
    for writes in tried:
        store = open_store(s3_url())
        broken_then_whole(work, store, "tok", writes)
        assert results(store) == results(quiet)


@pytest.fixture
def wild_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of this machine is set by an hour or a day, forth or back, whenever somebody looks at it."""
    real, rng = time.time, np.random.default_rng(8)
    monkeypatch.setattr(time, "time", lambda: real() + float(rng.choice([-_DAY_S, -3600.0, 0.0, 3600.0, _DAY_S])))


@pytest.mark.parametrize("work", [simulate, generate, export])
def test_work_under_a_clock_that_is_set_again_and_again_has_the_same_bytes(
    work: Work, store: Store, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    quiet = open_store((tmp_path / "quiet").as_uri())
    work(quiet, "tok")
    request.getfixturevalue("wild_clock")
    record = work(store, "tok")
    assert record.status == "Completed"
    assert record.updated_at_s >= record.created_at_s
    assert results(store) == results(quiet)


@pytest.mark.usefixtures("wild_clock")
def test_a_claim_is_not_taken_over_because_a_clock_was_set(store: Store) -> None:
    with hold_lively_claim(store, "claims/batch/b.json") as held, _holders_known_dead(is_dead=False):
        with hold_claim_unless_alive(store, "claims/batch/b.json") as other:
            assert other is None
        assert not held.lost


@pytest.mark.parametrize("skew", [timedelta(hours=1), timedelta(days=-1)])
def test_a_server_that_refuses_this_machines_clock_is_told_as_that_and_takes_requests_when_it_is_set(
    skew: timedelta, s3_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = botocore.auth.get_current_datetime
    with monkeypatch.context() as wrong:
        wrong.setattr(botocore.auth, "get_current_datetime", lambda *given, **named: right(*given, **named) + skew)
        with pytest.raises(StoreUnreachable, match=r"this machine's clock is not .*RequestTimeTooSkewed.*NTP"):
            s3_store.put("a.json", b"1")
    s3_store.put("a.json", b"1")
