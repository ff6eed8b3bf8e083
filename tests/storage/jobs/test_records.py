"""The same request twice is one job, an ended job stays as it ended, and every change is announced once."""

import hashlib
import json
import logging
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import uuid4

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import JsonValue

from specs.errors import DocumentError, IdempotentParameterMismatch, ResourceNotFound, StoreError, StoreUnreachable
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import JobFailureCode
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.keys import claim_key, job_key, token_key
from tasks.storage.base.store import Store
from tasks.storage.jobs import records
from tasks.storage.jobs.records import (
    JobRecord,
    JobTransition,
    advance,
    cancel_watched_job,
    changes_text,
    is_terminal,
    listen_to_transitions,
    read,
    request_digest,
    submit,
)
from tasks.storage.store_url import open_store, store_id
from tests.factories.lively_claims import hold_lively_claim
from tests.servers.racers import in_processes, submit_together

_KIND = "world-generation-job"
_REQUEST: dict[str, JsonValue] = {"template": "rooms", "worldCount": {"floorplanCount": 4}}
_STATUSES = ("Pending", "Running", "Canceling", *sorted(records.TERMINAL))
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(), lambda inner: st.dictionaries(st.text(), inner, max_size=4)
)


def test_a_new_job_is_pending_and_named_after_its_token(store: Store) -> None:
    record = submit(store, _KIND, _REQUEST, "tok")
    digest = hashlib.sha256(b"world-generation-job|tok").hexdigest()
    assert record.id == f"wgj-{digest[:16]}"
    assert record.arn == f"arn:simyard:world-generation-job:{store_id(store)}:{record.id}"
    assert (record.status, record.request, record.token) == ("Pending", _REQUEST, "tok")
    assert read(store, _KIND, record.id) == record


@pytest.mark.parametrize(
    ("kind", "prefix"),
    [
        ("world-export-job", "wej"),
        ("simulation-job-batch", "simb"),
        ("deployment-job", "dep"),
        ("pipeline-run", "run"),
    ],
)
def test_each_kind_of_job_has_its_prefix_and_arn(file_store: Store, kind: records.JobKind, prefix: str) -> None:
    record = submit(file_store, kind, _REQUEST, "tok")
    assert record.id.startswith(f"{prefix}-")
    assert record.arn == f"arn:simyard:{kind}:{store_id(file_store)}:{record.id}"


def test_the_same_token_and_request_give_the_same_job_as_it_stands_now(store: Store) -> None:
    record = submit(store, _KIND, _REQUEST, "tok")
    advanced = advance(store, _KIND, record.id, "Running")
    assert submit(store, _KIND, dict(reversed(_REQUEST.items())), "tok") == advanced


def test_the_same_token_with_another_request_names_both_digests(store: Store) -> None:
    other: dict[str, JsonValue] = {**_REQUEST, "template": "other"}
    record = submit(store, _KIND, _REQUEST, "tok")
    with pytest.raises(IdempotentParameterMismatch, match="clientRequestToken") as raised:
        submit(store, _KIND, other, "tok")
    assert request_digest(_REQUEST) in str(raised.value)
    assert request_digest(other) in str(raised.value)
    assert records.records(store, _KIND) == [record]


def test_the_same_token_serves_each_kind_of_job(file_store: Store) -> None:
    one = submit(file_store, "world-generation-job", {"a": 1}, "tok")
    other = submit(file_store, "world-export-job", {"a": 2}, "tok")
    assert one.id != other.id


def test_processes_that_submit_together_get_one_job(store: Store) -> None:
    answers = in_processes(submit_together, [(store.url, "tok")] * 4)
    assert len(set(answers)) == 1
    assert records.records(store, _KIND) == [JobRecord.model_validate_json(answers[0])]


class _DiesBetween(LocalStore):
    """The store of a process that dies after it recorded the token."""

    def create(self, key: str, body: bytes) -> str:
        if key.startswith("jobs/"):
            raise StoreUnreachable("died")
        return super().create(key, body)


def test_a_crash_between_token_and_job_is_completed_by_the_next(file_store: Store, tmp_path: Path) -> None:
    with pytest.raises(StoreUnreachable):
        submit(_DiesBetween(tmp_path / "store"), _KIND, _REQUEST, "tok")
    assert file_store.exists(token_key(_KIND, "tok"))
    record = submit(file_store, _KIND, _REQUEST, "tok")
    assert records.records(file_store, _KIND) == [record]


def test_a_crash_between_token_and_job_still_binds_the_token(file_store: Store, tmp_path: Path) -> None:
    with pytest.raises(StoreUnreachable):
        submit(_DiesBetween(tmp_path / "store"), _KIND, _REQUEST, "tok")
    with pytest.raises(IdempotentParameterMismatch):
        submit(file_store, _KIND, {"template": "other"}, "tok")


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        ("world-generation-job", "AccessDenied"),
        ("world-export-job", "AllWorldGenerationFailed"),
        ("simulation-job-batch", "InvalidInput"),
        ("deployment-job", "InternalServiceError"),
    ],
)
def test_no_record_says_a_code_of_another_kind(file_store: Store, kind: JobKind, code: JobFailureCode) -> None:
    job = submit(file_store, kind, _REQUEST, "tok").id
    with pytest.raises(ValueError, match=f"'{code}' is no failure code of a {kind}"):
        advance(file_store, kind, job, "Failed", failure_code=code)
    assert read(file_store, kind, job).status == "Pending"


def test_an_advance_sets_the_status_and_merges_the_detail(store: Store) -> None:
    job = submit(store, _KIND, _REQUEST, "tok").id
    advance(store, _KIND, job, "Running", detail={"worlds": ["a"], "seed": 1})
    more: dict[str, JsonValue] = {"worlds": ["b"]}
    after = advance(store, _KIND, job, "Failed", failure_code="InvalidInput", failure_reason="why", detail=more)
    assert (after.status, after.failure_code, after.failure_reason) == ("Failed", "InvalidInput", "why")
    assert after.detail == {"worlds": ["b"], "seed": 1}
    assert after.updated_at_s >= after.created_at_s
    assert read(store, _KIND, job) == after


def test_a_job_whose_token_is_gone_is_nobody_elses(store: Store) -> None:
    submit(store, "world-generation-job", {"template": "rooms"}, "mine")
    store.delete(token_key("world-generation-job", "mine"))
    with pytest.raises(IdempotentParameterMismatch, match="another token"):
        submit(store, "world-generation-job", {"template": "halls"}, "mine")


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A store for properties, whose examples use jobs of their own."""
    return open_store((tmp_path_factory.mktemp("records") / "store").as_uri())


# Reasons of one line are kept to the letter; what becomes of others has a test of its own.
_ONE_LINE = st.text(max_size=5).map(lambda text: " ".join(text.split()))


@given(statuses=st.lists(st.tuples(st.sampled_from(_STATUSES), _ONE_LINE), max_size=8))
def test_a_job_that_has_ended_stays_as_it_ended(shared: Store, statuses: list[tuple[str, str]]) -> None:
    record = submit(shared, _KIND, {}, uuid4().hex)
    for status, reason in statuses:
        before = record
        record = advance(shared, _KIND, record.id, status, failure_reason=reason, detail={reason: status})
        if is_terminal(before):
            assert record == before
        else:
            assert (record.status, record.failure_reason) == (status, reason)
    assert read(shared, _KIND, record.id) == record


def test_concurrent_advances_lose_nothing(store: Store) -> None:
    job = submit(store, _KIND, _REQUEST, "tok").id

    steps = 3 if store.url.startswith("s3:") else 30

    def work(worker: int) -> None:
        for step in range(steps):
            advance(store, _KIND, job, "Running", detail={f"{worker}-{step}": step})

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    expected = {f"{worker}-{step}": step for worker in range(4) for step in range(steps)}
    assert read(store, _KIND, job).detail == expected


def test_of_concurrent_endings_all_see_the_same_one(store: Store) -> None:
    job = submit(store, _KIND, _REQUEST, "tok").id
    ends = ("Completed", "Failed", "Canceled", "PartialFailed")
    with ThreadPoolExecutor(4) as pool:
        seen = list(pool.map(lambda status: advance(store, _KIND, job, status), ends))
    assert {record.model_dump_json() for record in seen} == {read(store, _KIND, job).model_dump_json()}


def test_a_status_that_is_none_is_refused(file_store: Store) -> None:
    job = submit(file_store, _KIND, _REQUEST, "tok").id
    with pytest.raises(ValueError, match="'Cancelled' is no job status"):
        advance(file_store, _KIND, job, "Cancelled")


def test_a_change_that_comes_too_late_for_the_jobs_status_changes_nothing(store: Store) -> None:
    job = submit(store, _KIND, _REQUEST, "tok").id
    canceling = advance(store, _KIND, job, "Canceling")
    assert advance(store, _KIND, job, "Running", detail={"step": 1}, only_from={"Pending"}) == canceling
    assert read(store, _KIND, job) == canceling
    assert advance(store, _KIND, job, "Canceled", only_from={"Canceling"}).status == "Canceled"


def test_a_job_that_does_not_exist_is_named(store: Store) -> None:
    with pytest.raises(ResourceNotFound, match="world-generation-job: 'wgj-0'"):
        read(store, _KIND, "wgj-0")
    with pytest.raises(ResourceNotFound):
        advance(store, _KIND, "wgj-0", "Running")
    assert not store.exists(job_key(_KIND, "wgj-0"))


def test_jobs_are_listed_oldest_first_and_by_kind(file_store: Store) -> None:
    made = [submit(file_store, _KIND, _REQUEST, f"tok-{number}") for number in range(5)]
    submit(file_store, "world-export-job", _REQUEST, "tok")
    assert records.records(file_store, _KIND) == made


def test_no_jobs_are_an_empty_list(store: Store) -> None:
    assert records.records(store, "deployment-job") == []


@given(st.dictionaries(st.text(), _JSON, max_size=5))
def test_the_digest_does_not_depend_on_the_order_of_keys(request_: Mapping[str, JsonValue]) -> None:
    assert request_digest(dict(reversed(list(request_.items())))) == request_digest(request_)


@given(st.dictionaries(st.text(), _JSON, max_size=5), st.dictionaries(st.text(), _JSON, max_size=5))
def test_digests_differ_as_requests_do(one: Mapping[str, JsonValue], other: Mapping[str, JsonValue]) -> None:
    same = json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    assert (request_digest(one) == request_digest(other)) == same


def test_the_digest_is_the_one_of_canonical_json() -> None:
    assert request_digest({"b": [1, 2], "a": "ö"}) == hashlib.sha256('{"a":"ö","b":[1,2]}'.encode()).hexdigest()


def test_a_reason_is_kept_as_one_line_that_robomaker_could_have_told(file_store: Store) -> None:
    record = submit(file_store, _KIND, _REQUEST, "tok")
    ended = advance(file_store, _KIND, record.id, "Failed", failure_reason="two faults\n  one\n" + 2000 * "x")
    assert ended.failure_reason.startswith("two faults one x")
    assert len(ended.failure_reason) == 1024


def test_who_comes_with_an_older_epoch_writes_nothing(store: Store) -> None:
    record = submit(store, "deployment-job", {}, "one")
    advance(store, "deployment-job", record.id, "InProgress", epoch=2)
    with pytest.raises(StoreError, match="since epoch 2"):
        advance(store, "deployment-job", record.id, "Succeeded", epoch=1)
    # Who has no claim, as somebody who cancels, takes no epoch back.
    advance(store, "deployment-job", record.id, "InProgress", detail={"wish": "pause"})
    with pytest.raises(StoreError, match="since epoch 2"):
        advance(store, "deployment-job", record.id, "Succeeded", epoch=1)
    assert advance(store, "deployment-job", record.id, "Succeeded", epoch=2).status == "Succeeded"


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}, "a.b[1] was 2 and is 3"),
        ({"a": [1]}, {"a": [1, 2]}, "a was a list of 1 and is a list of 2"),
        ({}, {"a": "x"}, "a was nothing and is 'x'"),
        (
            {"a": 1, "b": 1, "c": 1, "d": 1},
            {},
            "a was 1 and is nothing, b was 1 and is nothing, c was 1 and is nothing, ...",
        ),
    ],
)
def test_the_first_fields_that_differ_are_told_with_both_values(before: JsonValue, after: JsonValue, said: str):
    assert changes_text(before, after) == said


def test_a_reused_token_names_the_field_that_changed(file_store: Store):
    submit(file_store, "simulation-job-batch", {"seeds": [1], "lanes": 8}, "batch-1")
    with pytest.raises(
        IdempotentParameterMismatch, match=r"'batch-1': came before .*: lanes was 8 and is 16; send the same one"
    ):
        submit(file_store, "simulation-job-batch", {"seeds": [1], "lanes": 16}, "batch-1")


KIND = "world-export-job"


@pytest.fixture
def job(store: Store) -> str:
    return submit(store, KIND, {}, "one").id


def test_each_change_of_status_is_told_once_and_nothing_else(store: Store, job: str):
    heard: list[JobTransition] = []
    with listen_to_transitions(heard.append):
        advance(store, KIND, job, "Running")
        advance(store, KIND, job, "Running", detail={"worlds": 3})
        advance(store, KIND, job, "Failed", failure_code="InvalidInput", failure_reason="no worlds")
        advance(store, KIND, job, "Completed")
    record = read(store, KIND, job)
    assert heard == [
        JobTransition(KIND, record.arn, "Pending", "Running", "", ""),
        JobTransition(KIND, record.arn, "Running", "Failed", "InvalidInput", "no worlds"),
    ]


def test_what_is_told_is_in_the_store_already(store: Store, job: str):
    found: list[str] = []
    with listen_to_transitions(lambda _change: found.append(read(store, KIND, job).status)):
        advance(store, KIND, job, "Running")
    assert found == ["Running"]


def test_a_change_that_is_not_made_is_not_told(store: Store, job: str):
    heard: list[JobTransition] = []
    with listen_to_transitions(heard.append):
        advance(store, KIND, job, "Completed", only_from={"Running"})
    assert heard == []


def test_nobody_hears_outside_the_block(store: Store, job: str):
    heard: list[JobTransition] = []
    with listen_to_transitions(heard.append):
        pass
    advance(store, KIND, job, "Running")
    assert heard == []


def test_a_change_is_logged_with_its_facts(file_store: Store, caplog: pytest.LogCaptureFixture):
    record = submit(file_store, KIND, {}, "one")
    with caplog.at_level(logging.INFO, logger="tasks.storage.jobs.records"):
        advance(file_store, KIND, record.id, "Running")
    (line,) = caplog.records
    assert line.getMessage() == f"{record.arn} is Running"
    assert line.__dict__["fields"] == {"kind": KIND, "arn": record.arn, "was": "Pending", "status": "Running"}


def test_a_failure_is_logged_with_its_code_and_reason(file_store: Store, caplog: pytest.LogCaptureFixture):
    record = submit(file_store, KIND, {}, "one")
    with caplog.at_level(logging.INFO, logger="tasks.storage.jobs.records"):
        advance(file_store, KIND, record.id, "Failed", failure_code="InvalidInput", failure_reason="no worlds")
    assert caplog.messages == [f"{record.arn} is Failed: InvalidInput: no worlds"]


@pytest.mark.parametrize(("kind", "flow"), [("pipeline-run", "world-generation"), (KIND, "")])
def test_a_change_of_a_run_names_its_flow(file_store: Store, kind: JobKind, flow: str):
    record = submit(file_store, kind, {"flow": flow or "any"}, "one")
    heard: list[JobTransition] = []
    with listen_to_transitions(heard.append):
        advance(file_store, kind, record.id, "Running")
    assert [each.flow for each in heard] == [flow]


def test_a_job_that_nobody_works_on_is_canceled_at_once(file_store: Store) -> None:
    job = submit(file_store, KIND, {}, "one").id
    assert cancel_watched_job(file_store, KIND, job).status == "Canceled"


def test_whoever_works_on_a_job_is_left_to_end_it(file_store: Store) -> None:
    job = submit(file_store, KIND, {}, "one").id
    with hold_lively_claim(file_store, claim_key(KIND, job)):
        advance(file_store, KIND, job, "Running")
        assert cancel_watched_job(file_store, KIND, job).status == "Canceling"
    assert read(file_store, KIND, job).status == "Canceling"
    assert cancel_watched_job(file_store, KIND, job).status == "Canceled"


def test_an_ended_job_is_not_canceled(file_store: Store) -> None:
    job = submit(file_store, KIND, {}, "one").id
    advance(file_store, KIND, job, "Completed")
    with pytest.raises(DocumentError, match="Completed"):
        cancel_watched_job(file_store, KIND, job)


def test_a_job_that_does_not_exist_is_not_found(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        cancel_watched_job(file_store, KIND, "wxj-0")
