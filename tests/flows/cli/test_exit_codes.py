"""How `simyard` ends: exit codes 1 and 4 are verdicts, and nothing else."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Generator

import pytest

from flows.cli.shell import app
from flows.cli.terminal import exit_with_code
from specs.base import Fault
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, PipelineNotPassed, SimyardError, StageFailed


@pytest.fixture(autouse=True)
def _handlers() -> Generator[None, None, None]:  # pyright: ignore[reportUnusedFunction] - used by every test
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def _raises(exc: BaseException) -> Callable[[], None]:
    def command() -> None:
        raise exc

    return command


def _code(command: Callable[[], object]) -> object:
    with pytest.raises(SystemExit) as left, exit_with_code():
        command()
    return left.value.code


@pytest.mark.parametrize(
    ("exc", "code"),
    [
        (PipelineNotPassed(PipelineReport(run="run-1", name="nightly", stages=(), verdict="FAIL", shipped=None)), 1),
        (PipelineNotPassed(PipelineReport(run="r", name="n", stages=(), verdict="INCONCLUSIVE", shipped=None)), 4),
        (PipelineNotPassed(PipelineReport(run="r", name="n", stages=(), verdict="PASS", shipped=False)), 1),
        (DocumentError([Fault(path="a", value="1", allowed="2")]), 2),
        (StageFailed("InternalServiceError", "why"), 3),
        (SimyardError("why"), 3),
        (RuntimeError("why"), 3),
        (OSError("why"), 3),
    ],
)
def test_only_a_verdict_exits_with_1_or_4(exc: Exception, code: int, capsys: pytest.CaptureFixture[str]):
    assert _code(_raises(exc)) == code
    assert "Traceback" not in capsys.readouterr().err


def test_a_defect_is_one_line(capsys: pytest.CaptureFixture[str]):
    assert _code(_raises(RuntimeError("over\ntwo lines"))) == 3
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "defect of Simyard: RuntimeError: over two lines" in told


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS])
def test_a_disk_that_takes_nothing_is_no_defect(code: int, capsys: pytest.CaptureFixture[str]):
    assert _code(_raises(OSError(code, os.strerror(code), "/somewhere"))) == 3
    told = capsys.readouterr().err
    assert os.strerror(code) in told
    assert "defect" not in told


def test_a_defect_shows_where_when_it_is_asked_to(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_DEBUG", "1")
    assert _code(_raises(RuntimeError("why"))) == 3
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_command_says_how_to_go_on(
    number: signal.Signals, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("sys.argv", ["simyard", "down"])
    monkeypatch.setattr("flows.cli.server_commands.end_kept", lambda _: signal.raise_signal(number))
    assert _code(app) == code
    assert capsys.readouterr().err == "interrupted; the same command continues this run if the document is unchanged\n"


def test_an_interrupt_that_became_another_exception_is_still_one(capsys: pytest.CaptureFixture[str]):
    def command() -> None:
        signal.signal(signal.SIGTERM, lambda *_: None)  # as Prefect does inside a flow
        signal.raise_signal(signal.SIGTERM)
        raise RuntimeError("the flow run crashed")

    assert _code(command) == 143
    assert "interrupted" in capsys.readouterr().err


def test_an_interrupt_that_is_swallowed_ends_the_process_later():
    script = """
import signal, threading
from flows.cli.terminal import exit_with_code

def command():
    try:
        signal.raise_signal(signal.SIGTERM)
    except SystemExit:
        threading.Event().wait(250)

with exit_with_code(grace_s=0.0):
    command()
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ended.returncode == 143
    assert ended.stderr.strip() == "interrupted; the same command continues this run if the document is unchanged"


@pytest.mark.long
@pytest.mark.parametrize(("second", "code"), [("SIGINT", 130), ("SIGTERM", 5)])
def test_only_a_second_ctrl_c_does_not_wait_for_what_the_first_signal_began(second: str, code: int):
    script = f"""
import signal, threading
from flows.cli import terminal

def command():
    signal.raise_signal(signal.SIGINT)

def slow_to_leave():
    try:
        command()
    except SystemExit:
        signal.signal(signal.{second}, lambda *_: None)  # as Prefect does inside a flow
        threading.Event().wait(2 * terminal._SAME_KEY_S)
        signal.raise_signal(signal.{second})
        threading.Event().wait(250 if "{second}" == "SIGINT" else 2)
        raise SystemExit(5)

with terminal.exit_with_code(grace_s=240.0):
    slow_to_leave()
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ended.returncode == code, ended.stderr


def test_a_thread_that_never_ends_keeps_no_process_alive():
    script = """
import threading
from flows.cli.terminal import end_process

with end_process(grace_s=0.1):
    threading.Thread(target=threading.Event().wait).start()
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_a_signal_that_the_parent_ignores_stays_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assert _code(lambda: signal.raise_signal(signal.SIGINT)) == 0


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [(["--help"], 0, "From a world template"), (["nonsense"], 2, "nonsense"), (["list"], 2, "KIND")],
)
def test_the_parser_keeps_its_say(
    arguments: list[str],
    code: int,
    word: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr("sys.argv", ["simyard", *arguments])
    assert _code(app) == code
    out, err = capsys.readouterr()
    assert word.lower() in (out + err).lower()


@pytest.mark.parametrize("code", [0, 5])
def test_a_command_that_chose_its_exit_code_keeps_it(code: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["simyard", "agent"])
    monkeypatch.setattr("tasks.deploy.robot.agent.main", lambda _: code)
    assert _code(app) == code


def test_faults_of_a_command_without_a_document_have_no_heading_of_one(capsys: pytest.CaptureFixture[str]):
    assert _code(_raises(DocumentError([Fault(path="fleet", value="'x'", allowed="a fleet")]))) == 2
    assert capsys.readouterr().err == "fleet: 'x': a fleet\n"
