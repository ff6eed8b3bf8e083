"""What commands print neither steers the terminal nor is read as markup; and what they do when nobody reads it."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import pytest
from pydantic import JsonValue
from rich.live import Live
from rich.table import Table
from rich.text import Text

from flows.cli import terminal
from flows.cli.terminal import TerminalConsole, echo, echo_json, exit_with_code, go_on_unread, show_rows
from tests.repository import ROOT

HOSTILE = "\x1b[2J\x9b31mno camera at [/dev/video0] [bold]\u202e\r:boom:"
SHOWN = "[2J31mno camera at [/dev/video0] [bold]:boom:"


def test_a_reason_that_looks_like_markup_is_printed_as_it_stands():
    out = io.StringIO()
    console = TerminalConsole(file=out, width=200)
    table = Table(title=HOSTILE)
    table.add_column(HOSTILE)
    table.add_row(HOSTILE)
    console.print(HOSTILE, table)
    assert out.getvalue().count(SHOWN) == 4
    assert not set(out.getvalue()) & set("\x1b\x9b\r\u202e")


def test_a_console_still_moves_its_own_cursor(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    out = io.StringIO()
    with Live(HOSTILE, console=TerminalConsole(file=out, width=200), auto_refresh=False) as live:
        live.update("and now", refresh=True)
    assert "\x1b[2K" in out.getvalue()
    assert "\x1b[2J" not in out.getvalue()


def test_rows_of_a_stranger_stay_in_their_cells():
    out = io.StringIO()
    show_rows([{"name": "one\ntwo", "status": HOSTILE}], TerminalConsole(file=out))
    assert [line.split(maxsplit=2) for line in out.getvalue().splitlines()] == [
        ["name", "status"],
        ["one", "two", SHOWN],
    ]


BATCH_ROW: Mapping[str, JsonValue] = {
    "arn": "arn:simyard:simulation-job-batch:c8dcfa1f0f83:simb-d1a56ccb0be0a3bd",
    "document": "nightly",
    "passed": "1000/1000",
    "createdAt": 1.0e9,
    "status": "Completed",
    "failedRequestCount": 0,
}


@pytest.mark.parametrize(
    ("width", "headings", "left_out"),
    [
        (200, ["arn", "document", "passed", "createdAt", "status", "failedRequestCount"], ""),
        (80, ["id", "document", "passed", "createdAt", "status"], "failedRequestCount"),
        (60, ["id", "document", "passed", "status"], "createdAt, failedRequestCount"),
        (9, ["id"], "document, passed, createdAt, status, failedRequestCount"),
    ],
)
def test_rows_are_as_wide_as_the_terminal_and_ids_stay_whole(
    width: int,
    headings: list[str],
    left_out: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    out = io.StringIO()
    show_rows([BATCH_ROW], TerminalConsole(file=out, width=width))
    head, row = (line.rstrip() for line in Text.from_ansi(out.getvalue()).plain.splitlines())
    assert head.split() == headings
    assert "simb-d1a56ccb0be0a3bd" in row
    assert len(row) <= max(width, len("simb-d1a56ccb0be0a3bd"))
    assert capsys.readouterr().err == (
        f"left out, for want of width: {left_out}; a pipe has all: | less -S\n" if left_out else ""
    )


def test_a_name_that_is_the_id_is_not_told_of_as_left_out(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    out = io.StringIO()
    show_rows(
        [{"arn": "arn:simyard:deployment-fleet:c8dcfa1f0f83:home", "name": "home"}], TerminalConsole(file=out, width=40)
    )
    assert Text.from_ansi(out.getvalue()).plain.split() == ["id", "home"]
    assert capsys.readouterr().err == ""


def test_rows_in_a_pipe_are_whole():
    out = io.StringIO()
    show_rows([BATCH_ROW], TerminalConsole(file=out, width=60))
    assert str(BATCH_ROW["arn"]) in out.getvalue()
    assert "failedRequestCount" in out.getvalue()


def test_lines_and_json_are_printed_without_what_steers(capsys: pytest.CaptureFixture[str]):
    echo(HOSTILE)
    assert capsys.readouterr().out == f"{SHOWN}\n"
    echo_json(json.dumps({"reason": HOSTILE}, ensure_ascii=False))
    assert json.loads(printed := capsys.readouterr().out) == {"reason": HOSTILE}
    assert printed.rstrip("\n").isprintable()


@contextmanager
def _unread(monkeypatch: pytest.MonkeyPatch) -> Generator[None]:
    """Has a stdout that nobody reads for the block."""
    reading, writing = os.pipe()
    os.close(reading)
    monkeypatch.setattr(terminal, "_goes_on", Event())
    with os.fdopen(writing, "w") as out, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", out)
        yield


@pytest.mark.parametrize("say", [echo, echo_json, lambda text: TerminalConsole().print(text)])
def test_a_command_whose_reader_is_gone_ends_with_no_verdicts_code(
    monkeypatch: pytest.MonkeyPatch, say: Callable[[str], None]
):
    with _unread(monkeypatch), pytest.raises(SystemExit) as ended:
        say("{}")
    assert ended.value.code == 141


def test_a_run_whose_reader_is_gone_goes_on_and_says_so_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    with _unread(monkeypatch):
        go_on_unread()
        for _ in range(2):
            echo("a stage")
            TerminalConsole().print("a table")
    assert capsys.readouterr().err.count("the run goes on to its end") == 1


def test_the_parsers_answer_to_a_reader_that_is_gone_is_no_verdict():
    answer = SystemExit(1)
    answer.__context__ = BrokenPipeError()
    with pytest.raises(SystemExit) as ended, exit_with_code():
        raise answer
    assert ended.value.code == 141


def test_a_folder_that_is_gone_and_a_variable_that_leads_nowhere_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "file"))
    with pytest.raises(SystemExit), exit_with_code():
        raise NotADirectoryError(20, "Not a directory", str(tmp_path / "file/kept.json"))
    assert "Not a directory; the environment variable PREFECT_HOME leads there" in capsys.readouterr().err
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SystemExit), exit_with_code():
        Path.cwd()
    assert "the folder that this command was called in is gone" in capsys.readouterr().err


def test_a_variable_that_an_exception_names_is_to_blame_and_its_value_is_not_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("JAXTYPING_DISABLE", "canary")
    with pytest.raises(SystemExit), exit_with_code():
        raise ValueError("Unrecognised value for `JAXTYPING_DISABLE`.")
    said = capsys.readouterr().err
    assert "look at the environment variable JAXTYPING_DISABLE, which is set" in said
    assert "canary" not in said


INTERRUPTED = """
import os, signal, sys

class Finder:
    def find_spec(name, *_):
        if name == "{module}":
            os.kill(os.getpid(), signal.SIGINT)

sys.argv = ["simyard"]
sys.meta_path.insert(0, Finder)
from simyard.__main__ import main
main()
"""


@pytest.mark.parametrize("module", ["simyard.hidden_packages", "simyard.__main__", "flows.cli.shell"])
def test_an_interrupt_while_the_command_is_imported_shows_no_traceback(module: str):
    program = [sys.executable, "-c", INTERRUPTED.format(module=module)]
    ended = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, "interrupted before anything began\n")


def test_in_no_columns_help_is_printed():
    done = subprocess.run(
        [sys.executable, "-m", "simyard", "--help"],
        env={**os.environ, "COLUMNS": "0"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "validate" in done.stdout
