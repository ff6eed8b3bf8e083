"""Output of the command line: tables in a terminal, JSON lines for programs.

All that a command prints goes through ``echo``, ``echo_json`` or a ``TerminalConsole``: whatever a stranger wrote into
the store, it neither steers the terminal nor is read as rich's markup.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import IO

import typer
from pydantic import JsonValue
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from specs.base import Spec
from specs.data.run_report import PipelineReport
from specs.terminal_text import terminal_json, terminal_line, terminal_text, without_commands

_WIDEST = 10_000
_LONGEST_CELL = 80
_GOOD = frozenset({"Completed", "Succeeded", "PASS", "InSync"})
_UNDECIDED = frozenset({"PartialFailed", "INCONCLUSIVE", "Pending", "InProgress", "Running", "Preparing"})


class TerminalConsole(Console):
    """A console that reads no markup, and prints no character that steers a terminal but those of its own styles."""

    def __init__(self, *, stderr: bool = False, file: IO[str] | None = None, width: int | None = None) -> None:
        """Writes to the terminal.

        Args:
            stderr: Whether to stderr.
            file: Where else, if anywhere.
            width: In characters; the terminal's own, if left out.
        """
        super().__init__(stderr=stderr, file=file, width=width, markup=False, emoji=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yields what is printed; moving the cursor is no text, and stays."""
        before = ""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
                continue
            # What is an order may come in parts: rich ends a segment wherever the style changes.
            text = _text(before + segment.text)[len(before) :]
            before = (before + text)[-2:]
            yield Segment(text, segment.style)


def echo(text: object, *, err: bool = False) -> None:
    """Prints a text to stdout or stderr, without what steers a terminal."""
    typer.echo(_text(str(text)), err=err)


def echo_commands(line: str) -> None:
    """Prints a line that GitHub's runner obeys, as it is, to stderr: stdout may be a document."""
    typer.echo(line, err=True)


def echo_json(text: str) -> None:
    """Prints JSON to stdout; what steers a terminal or a runner is escaped, so that programs read the same."""
    typer.echo(terminal_json(text).replace("##[", "\\u0023#["))


def show_report(report: PipelineReport, console: Console) -> None:
    """Shows a run: a line a stage, where its artefacts lie, and the answer."""
    table = Table(title=Text(f"{report.name} ({report.run})"), title_justify="left")
    table.add_column("stage")
    table.add_column("status")
    table.add_column("what came of it")
    table.add_column("seconds", justify="right")
    for stage in report.stages:
        table.add_row(Text(stage.name), _status(stage.status), Text(stage.summary), f"{stage.seconds:.1f}")
    console.print(table)
    for stage in report.stages:
        if stage.arn:
            _line(console, stage.name, stage.arn)
        for artefact in stage.artefacts:
            _line(console, f"  {artefact.label}", artefact.url)
    alarms = (line for stage in report.stages for line in str(stage.facts.get("alarm", "")).splitlines())
    for alarm in dict.fromkeys(alarms):  # batch and gate may warn of the same
        console.print(Text(alarm, style="bold red"), soft_wrap=True)
    console.print(_answer(report))


def show_rows(rows: Sequence[Mapping[str, JsonValue]], console: Console) -> None:
    """Shows rows under headings: each thing's own ARN, whole, and what fits beside it; `--json` has everything."""
    shown = [{key: value for key, value in row.items() if _fits(key, value)} for row in rows]
    table = Table(box=None, pad_edge=False)
    columns = list(dict.fromkeys(key for row in shown for key in row))
    for column in columns:
        table.add_column(Text(column), no_wrap=True)
    for row in shown:
        table.add_row(*(_cell(column, row.get(column)) for column in columns))
    # As wide as its content: a terminal may wrap a line, but nothing is cut off.
    TerminalConsole(file=console.file, width=_WIDEST).print(table, soft_wrap=True)


def page_rows(page: Spec) -> tuple[list[dict[str, JsonValue]], str | None]:
    """Returns the rows of a List call's answer, and the token of the next page; None on the last."""
    document = page.model_dump(mode="json", exclude_none=True)
    token = document.pop("nextToken", None)
    return [row for rows in document.values() for row in rows], token


def json_lines(documents: Iterable[Spec]) -> Iterable[str]:
    """Yields each document as one line of JSON, without the fields that say nothing."""
    for document in documents:
        yield document.model_dump_json(exclude_none=True)


def _line(console: Console, label: str, url: str) -> None:
    console.print(Text(f"{label:<22} {url}"), soft_wrap=True)


def _status(status: str) -> Text:
    style = "green" if status in _GOOD else "yellow" if status in _UNDECIDED else "red"
    return Text(status, style=style)


def _answer(report: PipelineReport) -> Text:
    if report.passed and report.verdict is None and any(stage.name == "simulationBatch" for stage in report.stages):
        return Text(
            "Done. No gate was asked for, so nobody judged the batch: look at its numbers.", style="bold yellow"
        )
    behind = next((stage.facts["behind"] for stage in report.stages if "behind" in stage.facts), None)
    if report.passed and behind:
        why = "as many as may fail; simyard fleet watch tells who, and why"
        return Text(f"Done, but robots that are not in sync: {behind}, {why}.", style="bold yellow")
    unmet = next((stage.facts["unmet_wishes"] for stage in report.stages if "unmet_wishes" in stage.facts), None)
    if report.passed and unmet:
        said = f"Done, but wishes of the template that its worlds do not fulfil: {unmet}; the contact sheet shows them."
        return Text(said, style="bold yellow")
    if report.passed:
        return Text("Done, and everything that was asked for passed.", style="bold green")
    if report.verdict not in (None, "PASS"):
        left = "" if report.shipped is None else ": nothing was deployed"
        return Text(f"The gate says {report.verdict}{left}.", style="bold red")
    return Text("The deployment failed.", style="bold red")


def _text(text: str) -> str:
    """Returns a text for the terminal; in GitHub Actions also without what the runner would take for an order."""
    shown = terminal_text(text)
    return without_commands(shown) if os.environ.get("GITHUB_ACTIONS") == "true" else shown


def _fits(column: str, value: JsonValue) -> bool:
    if isinstance(value, (list, dict)):
        return False
    return column == "arn" or not (isinstance(value, str) and value.startswith("arn:"))


def _cell(column: str, value: JsonValue) -> Text:
    if value is None:
        return Text("")
    if column.endswith(("At", "Time")) and isinstance(value, float):
        return Text(datetime.fromtimestamp(value, tz=UTC).isoformat(sep=" ", timespec="seconds"))
    line = terminal_line(str(value))
    if column != "arn" and len(line) > _LONGEST_CELL:  # one long reason would pad all rows with blanks
        line = f"{line[:_LONGEST_CELL]}..."
    return _status(line) if column == "status" else Text(line)
