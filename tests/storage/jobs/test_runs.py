"""Runs: the same document continues what did not end, and begins anew after an end."""

import subprocess
import sys
import textwrap

import pytest
from pydantic import JsonValue

from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance, is_terminal, records, submit
from tasks.storage.jobs.runs import begin_run, document_of_run, stage_token
from tasks.storage.store_url import open_store

IDENTITY: dict[str, JsonValue] = {"flow": "pipeline", "spec": {"name": "nightly"}}


def _ended(store: Store) -> str:
    with begin_run(store, IDENTITY) as run:
        assert not is_terminal(run)
        advance(store, "pipeline-run", run.id, "Completed")
    return run.id


def test_a_run_that_did_not_end_is_continued(file_store: Store):
    with begin_run(file_store, IDENTITY) as first:
        pass
    with begin_run(file_store, IDENTITY) as second:
        assert second.id == first.id


def test_after_an_end_the_next_run_begins(file_store: Store):
    assert len({_ended(file_store) for _ in range(9)}) == 9
    assert len(records(file_store, "pipeline-run")) == 9


def test_who_waited_for_a_run_elsewhere_is_told_its_end_and_begins_no_other(file_store: Store):
    ended = _ended(file_store)
    with begin_run(file_store, IDENTITY, awaited=ended) as run:
        assert (run.id, run.status) == (ended, "Completed")
    assert len(records(file_store, "pipeline-run")) == 1


@pytest.mark.parametrize("other", ["of another document", "of another store"])
def test_a_run_that_cannot_be_its_own_is_not_what_it_waited_for(file_store: Store, other: str):
    with begin_run(file_store, {"flow": "pipeline", "spec": {"name": "weekly"}}) as weekly:
        awaited = weekly.id if other == "of another document" else "run-0123456789abcdef"
    with begin_run(file_store, IDENTITY, awaited=awaited) as run:
        assert (run.id != awaited, run.status) == (True, "Pending")


def test_another_document_is_another_run(file_store: Store):
    with (
        begin_run(file_store, IDENTITY) as run,
        begin_run(file_store, {"flow": "pipeline", "spec": {"name": "weekly"}}) as other,
    ):
        assert run.id != other.id


def test_the_first_run_of_a_document_has_the_same_id_in_every_store(
    file_store: Store, tmp_path_factory: pytest.TempPathFactory
):
    other = open_store(tmp_path_factory.mktemp("other").as_uri())
    assert _ended(file_store) == _ended(other)


def test_stages_of_one_run_have_tokens_that_robomaker_would_accept(file_store: Store):
    with begin_run(file_store, IDENTITY) as run:
        tokens = {stage_token(run, stage) for stage in ("worlds", "deployment")}
    assert len(tokens) == 2
    assert all(len(token) <= 64 and token.replace("-", "").isalnum() for token in tokens)


def test_who_waited_for_another_process_finds_the_run_ended(file_store: Store):
    other = subprocess.Popen(
        [
            sys.executable,
            "-c",
            textwrap.dedent(f"""
                import sys
                from tasks.storage.store_url import open_store
                from tasks.storage.jobs.records import advance
                from tasks.storage.jobs.runs import begin_run
                store = open_store({file_store.url!r})
                with begin_run(store, {IDENTITY!r}) as run:
                    print("holding", flush=True)
                    sys.stdin.read()
                    advance(store, "pipeline-run", run.id, "Completed")
            """),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with other:
        ends, told = other.stdin, other.stdout
        assert ends
        assert told
        assert told.readline() == b"holding\n"
        with begin_run(file_store, IDENTITY, waiting=lambda *_: ends.close()) as run:
            assert is_terminal(run)
    assert len(records(file_store, "pipeline-run")) == 1


@pytest.mark.parametrize(
    ("identity", "name"),
    [
        ({"flow": "pipeline", "spec": {"name": "nightly"}}, "nightly"),
        ({"flow": "world-generation", "spec": {"name": "a section has none"}}, "world-generation"),
        ({"flow": "world-export"}, "world-export"),
    ],
)
def test_a_run_has_its_documents_name_or_that_of_a_flow_alone(
    file_store: Store, identity: dict[str, JsonValue], name: str
):
    assert document_of_run(submit(file_store, "pipeline-run", identity, "one")) == name
