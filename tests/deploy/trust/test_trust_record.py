"""What the owner vouches for in the queue, which anybody may write to."""

from collections.abc import Callable, Mapping

import pytest
from pydantic import JsonValue

from specs.errors import TrustRefused
from tasks.deploy.trust import trust_record
from tasks.deploy.trust.trust_record import require_vouched, vouch_queued
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, submit

REQUEST: Mapping[str, JsonValue] = {"fleet": "couriers", "clientRequestToken": "t"}
DIGEST, ANOTHER = "1" * 64, "2" * 64


@pytest.fixture(autouse=True)
def own_key(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(tmp_path_factory.mktemp("owner") / "key"))


@pytest.fixture
def record(file_store: Store) -> JobRecord:
    job = submit(file_store, "deployment-job", dict(REQUEST), "t")
    return job.model_copy(update={"detail": vouch_queued(job.id, REQUEST, DIGEST, {"ARM64": ANOTHER})})


def test_what_was_vouched_for_is_what_is_deployed(record: JobRecord) -> None:
    vouched = require_vouched(record, sync=False)
    assert (vouched.digest, vouched.builds) == (DIGEST, {"ARM64": ANOTHER})


def _with(record: JobRecord, **changes: JsonValue) -> JobRecord:
    vouched = record.detail["vouched"]
    assert isinstance(vouched, dict)
    return record.model_copy(update={"detail": {"vouched": {**vouched, **changes}}})


@pytest.mark.parametrize(
    "change",
    [
        lambda record: record.model_copy(update={"detail": {}}),
        lambda record: record.model_copy(update={"detail": {"vouched": {"at_s": 1e999}}}),
        lambda record: record.model_copy(update={"request": {**REQUEST, "fleet": "another"}}),
        lambda record: record.model_copy(update={"id": "dep-0123456789abcdef"}),
        lambda record: _with(record, digest=ANOTHER),
        lambda record: _with(record, builds={}),
        lambda record: _with(record, at_s=1.0),
        lambda record: _with(record, mac=""),
    ],
)
def test_what_was_changed_in_the_store_is_not_signed(
    change: Callable[[JobRecord], JobRecord], record: JobRecord
) -> None:
    with pytest.raises(TrustRefused, match="does not vouch for it as it stands"):
        require_vouched(change(record), sync=False)


def test_a_deployment_is_no_sync(record: JobRecord) -> None:
    with pytest.raises(TrustRefused):
        require_vouched(record, sync=True)


def test_another_owners_word_does_not_count(record: JobRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_OWNER_KEY", "/nonexistent/key")
    with pytest.raises(TrustRefused, match="SIMYARD_OWNER_KEY"):
        require_vouched(record, sync=False)


@pytest.mark.parametrize("days", [-1, 31])
def test_what_was_vouched_for_long_ago_is_asked_for_again(
    days: int, record: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_s = require_vouched(record, sync=False).at_s
    monkeypatch.setattr(trust_record.time, "time", lambda: at_s + days * 86_400.0)
    with pytest.raises(TrustRefused, match="too long ago"):
        require_vouched(record, sync=False)
