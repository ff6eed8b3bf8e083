"""What commands print neither steers the terminal nor is read as markup."""

import io
import json

import pytest
from rich.live import Live
from rich.table import Table

from flows.cli.terminal import TerminalConsole, echo, echo_json, show_rows

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


def test_lines_and_json_are_printed_without_what_steers(capsys: pytest.CaptureFixture[str]):
    echo(HOSTILE)
    assert capsys.readouterr().out == f"{SHOWN}\n"
    echo_json(json.dumps({"reason": HOSTILE}, ensure_ascii=False))
    assert json.loads(printed := capsys.readouterr().out) == {"reason": HOSTILE}
    assert printed.rstrip("\n").isprintable()
