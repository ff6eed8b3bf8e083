"""docs/operate/operations.md, `When things stop`: its commands are the program's, its states and exit codes are so."""

import re
import signal

from flows.cli.shell import COMMANDS
from flows.prefect.flows import reaping
from tasks.storage.jobs.records import TERMINAL
from tests.repository import ROOT

SECTION = (
    (ROOT / "docs/operate/operations.md").read_text().partition("\n## When things stop\n")[2].partition("\n## ")[0]
)
_TABLE = SECTION.partition("| what stops it |")[2].partition("\n\n")[0]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")] for line in re.findall(r"^\| .*\|$", _TABLE, re.MULTILINE)
]


def test_the_commands_exist() -> None:
    assert (
        {"cancel", "reap", "run", "list", "describe"}
        <= set(re.findall("`simyard ([a-z]+)", SECTION))
        <= COMMANDS.keys()
    )
    assert f"The flow `{reaping.name}`" in SECTION


def test_the_states_are_terminal_but_for_a_run_that_goes_on() -> None:
    stopped = ROWS
    assert len(stopped) == 9
    states = {state for row in stopped for state in re.findall("`([A-Z][A-Za-z]+)`", row[1] + row[2])}
    assert states == {"Canceled", "TimedOut", "Completed", "Failed", "Running"}
    assert states - {"Running"} <= TERMINAL


def test_a_signal_ends_a_run_with_the_shells_code() -> None:
    codes = {row[0].split(",")[0].split()[0]: row[3] for row in ROWS if row[0].startswith("SIG")}
    assert codes["SIGINT"] == str(128 + signal.SIGINT)
    assert codes["SIGTERM"] == str(128 + signal.SIGTERM)
