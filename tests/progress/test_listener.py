"""Whom a run tells of its progress, also from threads of its own."""

from contextvars import ContextVar, copy_context
from threading import Barrier, Event
from time import sleep

import pytest

from specs.errors import StageFailed
from tasks.progress import listener as module
from tasks.progress.listener import (
    at_a_time,
    document_artifact_key,
    document_name,
    listen_to_progress,
    report_progress,
    waiting_for,
    work_for_document,
)


def test_a_key_has_the_name_of_the_document_inside_the_block_only():
    with work_for_document("nightly"):
        assert (document_name(), document_artifact_key("gate")) == ("nightly", "nightly--gate")
    assert (document_name(), document_artifact_key("gate")) == ("", "gate")


def test_a_run_in_a_run_has_its_own_name():
    with work_for_document("nightly"):
        with work_for_document("weekly"):
            assert document_artifact_key("gate") == "weekly--gate"
        assert document_artifact_key("gate") == "nightly--gate"


def test_a_listener_hears_what_is_told_inside_its_block_only():
    heard: list[tuple[str, int, int]] = []
    report_progress("Worlds", 0, 8)
    with listen_to_progress(lambda stage, done, total: heard.append((stage, done, total))):
        report_progress("Worlds", 1, 8)
    report_progress("Worlds", 2, 8)
    assert heard == [("Worlds", 1, 8)]


def test_a_task_in_a_copy_of_the_context_is_heard_too():
    heard: list[int] = []
    with listen_to_progress(lambda _stage, done, _total: heard.append(done)):
        copy_context().run(report_progress, "Episodes", 5, 9)
    assert heard == [5]


_ran = ContextVar("_ran", default="nobody")


def fail(code: str) -> None:
    raise StageFailed(code, code)


def test_each_stage_runs_while_the_other_does():
    both = Barrier(2)
    assert at_a_time(lambda: ("export", both.wait())[0], lambda: ("batch", both.wait())[0]) == ("export", "batch")


def test_a_stage_beside_another_is_in_the_same_context():
    token = _ran.set("the pipeline")
    try:
        assert at_a_time(_ran.get, lambda: None)[0] == "the pipeline"
    finally:
        _ran.reset(token)


def test_a_stage_comes_to_its_end_though_the_other_failed():
    ended: list[str] = []
    with pytest.raises(StageFailed, match="export"):
        at_a_time(lambda: fail("export"), lambda: ended.append("batch"))
    with pytest.raises(StageFailed, match="batch"):
        at_a_time(lambda: ended.append("export"), lambda: fail("batch"))
    assert ended == ["batch", "export"]


def test_of_two_failures_the_first_stage_s_is_told():
    with pytest.raises(StageFailed, match="export"):
        at_a_time(lambda: fail("export"), lambda: fail("batch"))


def interrupted() -> None:
    raise KeyboardInterrupt


def test_an_interrupt_waits_for_a_stage_that_is_about_to_end(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "_INTERRUPTED_S", 600.0)
    told: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        at_a_time(lambda: (sleep(0.2), told.append("the export has ended")), interrupted)
    assert told == ["the export has ended"]


def test_an_interrupt_does_not_wait_for_a_stage_that_goes_on(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "_INTERRUPTED_S", 0.1)
    held = Barrier(2)
    with pytest.raises(KeyboardInterrupt):
        at_a_time(held.wait, interrupted)
    held.abort()


def test_who_waits_long_hears_for_what_and_how_far_that_is():
    said, spoken, heard = list[str](), Event(), list[int]()

    def say(line: str) -> None:
        said.append(line)
        spoken.set()

    with listen_to_progress(lambda _stage, done, _total: heard.append(done)), waiting_for("a case", say, first_s=0.05):
        report_progress("Episodes", 3, 512)
        assert spoken.wait()
    assert said[0].endswith("a case: Episodes 3/512")
    assert heard == [3]


def test_who_waits_shortly_hears_nothing():
    said = list[str]()
    with waiting_for("a case", said.append):
        pass
    assert said == []
