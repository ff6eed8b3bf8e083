"""The command `simyard trend`."""
# ruff: noqa: PLC0415 - what it needs is imported when it runs

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flows.cli.output import TerminalConsole, echo, echo_json

if TYPE_CHECKING:
    from rich.console import Console

    from tasks.results.trend.view import NightRow, TrendView

_SHOWN = 14
_NUMBERS = {"counted", "worlds", "rate", "95 % interval"}


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
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Show a document's rates night by night, and where they changed."""
    from flows.trend.trend_page import TrendAsked, find_trend
    from tasks.results.trend.measure import parse_measure
    from tasks.results.trend.page import trend_page
    from tasks.results.trend.series import Choice
    from tasks.storage.store_url import open_existing_store

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
        _show(view, TerminalConsole())
    if view.notice:
        echo(view.notice, err=True)
    if output is not None:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_bytes(trend_page(view))
        echo(output.resolve().as_uri(), err=as_json)


def _variable(text: str) -> tuple[str, str]:
    from specs.base import Fault
    from specs.errors import DocumentError

    name, equals, value = text.partition("=")
    if not (name and equals):
        raise DocumentError([Fault(path="--variable", value=repr(text), allowed="NAME=VALUE")], source="simyard")
    return name, value


def _show(view: "TrendView", console: "Console") -> None:
    from rich.table import Table
    from rich.text import Text

    chosen = f", {view.chosen}" if view.chosen else ""
    table = Table(title=Text(f"{view.document}: {view.words}{chosen}"), title_justify="left", box=None, pad_edge=False)
    for heading in ("night", "robot application", "counted", "worlds", "rate", "95 % interval", ""):
        table.add_column(heading, justify="right" if heading in _NUMBERS else "left")
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
