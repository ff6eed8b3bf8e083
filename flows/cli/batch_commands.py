"""The commands `simyard report`, `gate` and `trend`, which look at batches that have ended."""

import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from flows.batch.batch_end import local_copy, write_report_page
from flows.batch.trend_history import TrendAsked, find_trend
from flows.cli.terminal import NOT_PASSED, UNDECIDED, StoreUrl, TerminalConsole, echo, echo_json, exit_code_of
from flows.pipeline.judge_again import judge_again
from specs.errors import DocumentError, SimyardError
from tasks.documents.pipeline_file import read_pipeline
from tasks.results.trend.trend_series import Choice, parse_measure
from tasks.results.trend.trend_view import NightRow, TrendView, trend_page
from tasks.storage.store_url import open_existing_store


def report(
    arn: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="A simulation job batch, one of its jobs, or a pipeline run: its ARN or id."
        ),
    ],
    *,
    show: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
    output: Annotated[
        Path | None, typer.Option(help="File to write. Default: report.html beside the tables.", show_default=False)
    ] = None,
    store: StoreUrl = None,
) -> None:
    """Write the report of a batch, one HTML file that needs nothing but itself, and print where it is."""
    place = write_report_page(open_existing_store(store), arn, output)
    echo(place.url)
    if place.notice:
        echo(place.notice, err=True)
    if show and not _opened(page := local_copy(place)):
        echo(f"no browser opens on this machine: open {page} in one elsewhere", err=True)


def _opened(page: Path) -> bool:
    """Returns whether a browser has opened a page; what the program that looks for one prints is not shown."""
    command, nowhere = ["xdg-open", page.as_uri()], subprocess.DEVNULL
    try:
        opener = subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere, start_new_session=True)  # noqa: S603 - the user's own
        return opener.wait(_OPENS_IN_S) == 0
    except FileNotFoundError:
        return False
    except subprocess.TimeoutExpired:  # it is the browser itself, and stays until it is closed
        return True


_OPENS_IN_S = 10.0
_STYLES = {"PASS": "bold green", "FAIL": "bold red", "INCONCLUSIVE": "bold yellow"}


def gate(
    batch: Annotated[
        str,
        typer.Argument(metavar="BATCH", help="A simulation job batch or a run of a document: its ARN or id."),
    ],
    *,
    document: Annotated[
        Path, typer.Option("--document", help="The document whose section gate judges.", show_default=False)
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    junit: Annotated[Path | None, typer.Option(help="Write a JUnit file.", show_default=False)] = None,
    store: StoreUrl = None,
) -> None:
    """Judge a batch that has ended by a document's gate, without simulating; 0 PASS, 1 FAIL, 4 INCONCLUSIVE."""
    opened, spec = open_existing_store(store), read_pipeline(document)
    with _told_of_failure(junit, spec.name, opened.url):
        found = judge_again(opened, batch, spec)
    if as_json:
        echo_json(found.model_dump_json(indent=2))
    else:
        console = TerminalConsole()
        for number, line in enumerate(found.lines()):
            style = _STYLES[found.verdict] if number == 0 else "bold yellow" if line in found.warnings else ""
            console.print(Text(line, style=style), soft_wrap=True)
        echo(f"evidence {found.evidence.url}")
        echo("this is a later judgement and ships nothing: to deploy, run the document")
    if found.notice:
        echo(found.notice, err=True)
    code = {"PASS": 0, "FAIL": NOT_PASSED, "INCONCLUSIVE": UNDECIDED}[found.verdict]
    if junit:
        from flows.cli.ci_report import report_of_judgement  # noqa: PLC0415 - few ask for JUnit
        from flows.cli.run_command import write_asked_junit  # noqa: PLC0415 - likewise

        write_asked_junit(junit, report_of_judgement(opened, spec, found, code))
    raise typer.Exit(code)


@contextmanager
def _told_of_failure(junit: Path | None, document: str, store_url: str) -> Generator[None, None, None]:
    """Leaves why in the JUnit file if the block fails, and never an older file."""
    if junit is None:
        yield
        return
    from flows.cli.ci_report import report_of_failure  # noqa: PLC0415 - likewise
    from flows.cli.run_command import AskedRun, prepare_junit, write_asked_junit  # noqa: PLC0415 - likewise

    asked = AskedRun(document, store_url)
    prepare_junit(junit, asked)
    try:
        yield
    except SimyardError as exc:
        write_asked_junit(junit, report_of_failure(asked, exc, exit_code_of(exc)))
        raise


_SHOWN = 14
_NUMBERS = {"counted", "worlds", "rate", "95 % interval"}
_ROOMY = 80
# In characters: no day, rate or word of a heading breaks before the rest does.
_LEAST_WIDTHS = {"night": 10, "robot application": 11, "counted": 6, "worlds": 6, "rate": 7, "95 % interval": 8, "": 6}


def trend(
    document: Annotated[
        str, typer.Argument(metavar="[DOCUMENT-NAME]", help="Name of a document. Default: the store's only one.")
    ] = "",
    *,
    since: Annotated[
        datetime | None, typer.Option(formats=["%Y-%m-%d"], help="First day to show, in UTC.", show_default=False)
    ] = None,
    last: Annotated[int, typer.Option(min=0, help="How many nights to show; 0 for all.")] = 0,
    world: Annotated[str, typer.Option(help="Only episodes in this world.", show_default=False)] = "",
    version: Annotated[
        str, typer.Option(help="Only episodes of this version, or of the bundle with this digest.", show_default=False)
    ] = "",
    variable: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Only episodes with this value; may be repeated.", show_default=False),
    ] = None,
    measure: Annotated[
        str, typer.Option(help="success, collision, or a column and a quantile: simulated_s:0.95.")
    ] = "success",
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    output: Annotated[
        Path | None, typer.Option(help="Write the page to this file, one HTML file.", show_default=False)
    ] = None,
    anew: Annotated[bool, typer.Option("--anew", help="Read all tables again; take nothing from the cache.")] = False,
    store: StoreUrl = None,
) -> None:
    """Show a document's rates night by night, and where they changed."""
    asked = TrendAsked(
        document=document,
        measure=parse_measure(measure),
        choice=Choice(world, version, tuple(map(_variable, variable or ()))),
        last=last,
        since_s=since.replace(tzinfo=UTC).timestamp() if since else 0.0,
        anew=anew,
    )
    view = find_trend(open_existing_store(store), asked)
    if as_json:
        echo_json(view.model_dump_json(indent=2, exclude={"whole", "multiples"}))
    else:
        _show_trend(view, TerminalConsole())
    if view.notice:
        echo(view.notice, err=True)
    if output is not None:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_bytes(trend_page(view))
        echo(output.resolve().as_uri(), err=as_json)


def _variable(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise DocumentError.of("--variable", repr(text), "NAME=VALUE", source="simyard")
    return name, value


def _show_trend(view: "TrendView", console: "Console") -> None:
    chosen = f", {view.chosen}" if view.chosen else ""
    table = Table(
        title=Text(f"{view.document}: {view.words}{chosen}"),
        title_justify="left",
        box=None,
        pad_edge=False,
        collapse_padding=console.width < _ROOMY,
    )
    for heading, least in _LEAST_WIDTHS.items():
        justify = "right" if heading in _NUMBERS else "left"
        table.add_column(heading, justify=justify, overflow="fold", min_width=least)
    for row in reversed(view.rows[:_SHOWN]):
        table.add_row(*map(Text, _cells(row)))
    console.print(table)
    console.print("Each rate is of that night's own worlds; of a hundred such intervals some five miss.")
    if view.nights > _SHOWN:
        console.print(f"{view.nights - _SHOWN:,} nights before them are not printed; --output and --json have more.")
    for alarm in reversed(view.alarms):
        console.print(Text(alarm.sentence, style="bold red" if alarm.fell else "bold green"), soft_wrap=True)
    if not view.alarms:
        console.print("No change was seen.")


def _cells(row: "NightRow") -> tuple[str, ...]:
    if row.rate is None or row.lower is None or row.upper is None:
        return row.day, row.bundle, "", "", "", "", row.note
    counted = f"{row.passed:,} of {row.episodes:,}"
    interval = f"{100 * row.lower:.1f} to {100 * row.upper:.1f}"
    return row.day, row.bundle, counted, f"{row.worlds:,}", f"{100 * row.rate:.1f} %", interval, row.note
