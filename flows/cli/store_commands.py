"""The commands `simyard gc` and `simyard reap`, which clean up a store."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from flows.cli.terminal import StoreUrl, TerminalConsole, echo, echo_json
from flows.prefect.prefect_server import known_server
from flows.resources.abandoned_jobs import reap_jobs as reap_store
from flows.resources.abandoned_jobs import under_way
from flows.resources.fleet_membership import renew_metadata_here
from specs.errors import DocumentError
from tasks.housekeeping.gc import Ages, FindingRow, GcReport, collect_garbage
from tasks.housekeeping.machine import MachineReport, MachineRow, clean_machine
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records
from tasks.storage.jobs.runs import FLOW_RUN, KIND
from tasks.storage.store_url import open_existing_store

_SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "w": 7 * 86400}


_UNITS = ("B", "KiB", "MiB", "GiB", "TiB")


_Age = Annotated[str, typer.Option(metavar="AGE", help="So long must nobody have written or named it; 24h, 7d.")]


_EndedAge = Annotated[
    str | None,
    typer.Option(
        "--older-than",
        metavar="AGE",
        help="Forget jobs that ended so long ago and that nothing names, with all they made.",
        show_default=False,
    ),
]


_UnusedAge = Annotated[
    str, typer.Option("--unused", metavar="AGE", help="So long must nobody have used what is in this machine's cache.")
]


def gc(
    *,
    yes: Annotated[bool, typer.Option("--yes", help="Remove it; without, it is only told.")] = False,
    grace: _Age = "24h",
    older_than: _EndedAge = None,
    unused: _UnusedAge = "30d",
    machine: Annotated[
        bool, typer.Option("--machine", help="Tell what lies outside of stores on this machine, to uninstall Simyard.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    store: StoreUrl = None,
) -> None:
    """Tell what no record of a store names, and what this machine's cache can spare; with --yes, remove it.

    Records that cannot be read end it with 3: what they might name stays.
    """
    if machine:
        _machine(cache_folder(), remove=yes, as_json=as_json)
        return
    ages = Ages(
        _seconds(grace, "--grace"),
        _seconds(older_than, "--older-than") if older_than else None,
        _seconds(unused, "--unused"),
    )
    report = collect_garbage(open_existing_store(store), cache_folder(), ages, remove=yes)
    if as_json:
        echo_json(report.model_dump_json(indent=2))
    else:
        _show_findings(report, TerminalConsole())
    for each in report.unread:
        echo(f"{report.store}: {each.record} cannot be read: {each.why}; {', '.join(each.keeps)} stay", err=True)
    if report.unread:
        raise typer.Exit(3)


def _machine(cache: Path, *, remove: bool, as_json: bool) -> None:
    report = clean_machine(cache, Path.home(), remove=remove)
    if as_json:
        echo_json(report.model_dump_json(indent=2))
        return
    for line in _machine_lines(report):
        echo(line)


def _machine_lines(report: "MachineReport") -> Iterator[str]:
    """Yields a line for what is of one sort in one folder, and then what it comes to."""
    groups: dict[tuple[str, str, str, str], list[MachineRow]] = {}
    for row in report.rows:
        groups.setdefault((row.what, row.owner, row.place.rpartition("/")[0], row.fate), []).append(row)
    for (what, owner, folder, fate), rows in groups.items():
        word, _, why = fate.partition(": ")
        word = "gone" if report.removed and rows[0].goes else word
        where = rows[0].place if len(rows) == 1 else f"{len(rows)} in {folder}"
        yield f"{word:<6}{_size(sum(row.bytes for row in rows)):>10}  {owner}  {what}: {where}" + (
            f" ({why})" if why else ""
        )
    total = _size(sum(row.bytes for row in report.rows if row.goes))
    yield f"{total} {'gone' if report.removed else 'would go with --yes'}; stores and robots: docs/guide/uninstall.md"


def _show_findings(report: "GcReport", console: Console) -> None:
    table = Table(title=report.store, title_justify="left")
    table.add_column("kind")
    table.add_column("objects", justify="right")
    table.add_column("size", justify="right")
    table.add_column("why")
    for row, why in _lines(report):
        table.add_row(row.kind, str(row.objects), _size(row.bytes), why)
    if table.row_count:
        console.print(table)
    objects, size = _total(report)
    freed = "freed" if report.removed else "to free"
    hint = "" if report.removed or not objects else "; --yes frees them"
    console.print(f"{freed}: {objects} objects, {_size(size)}{hint}", highlight=False)
    for line in report.left_out:
        console.print(f"not looked at: {line}", highlight=False, soft_wrap=True)


def _lines(report: "GcReport") -> "Iterator[tuple[FindingRow, str]]":
    yield from ((row, row.why) for row in report.freed)
    yield from ((row, f"of this machine's cache, {row.why}") for row in report.cache)
    yield from ((row, f"stays for now: {row.why}") for row in report.waiting)
    yield from ((row, "stays: it is in use again") for row in report.stayed)


def _total(report: "GcReport") -> tuple[int, int]:
    rows = (*report.freed, *report.cache)
    return sum(row.objects for row in rows), sum(row.bytes for row in rows)


def _size(size: float) -> str:
    for unit in _UNITS[:-1]:
        if size < 1024:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1024
    return f"{size:.1f} {_UNITS[-1]}"


def _seconds(text: str, option: str) -> float:
    found = re.fullmatch(r"(\d+)([smhdw])", text)
    if found is None:
        raise DocumentError.of(option, repr(text), "a number and s, m, h, d or w, such as 24h", source="simyard")
    return float(int(found[1]) * _SECONDS[found[2]])


def reap(
    *,
    outdated: Annotated[
        bool, typer.Option("--outdated", help="Cancel runs whose document was changed and has ended since, too.")
    ] = False,
    store: StoreUrl = None,
) -> None:
    """Tell which jobs nobody works on; end those that were being stopped, and ready the others to be run on.

    Flow runs whose process died become Crashed on the Prefect server of PREFECT_API_URL, else of simyard up, if one
    answers. With keys (SIMYARD_KEYS), also keeps what they have signed from expiring.
    """
    opened = open_existing_store(store)
    found = reap_store(opened, outdated=outdated)
    for each in found:
        change = each.status if each.status == each.was else f"{each.was} -> {each.status}"
        echo(f"{each.arn}  {change}: {each.meaning}")
    if not found:
        echo("somebody works on every job that is under way" if under_way(opened) else "no job is under way")
    for flow_run in _end_flow_runs(opened):
        echo(f"flow run {flow_run}  ended: its process is dead")
    for line in renew_metadata_here(opened):
        echo(f"{line}: simyard fleet keys renew, with its key", err=True)


def _end_flow_runs(store: "Store") -> list[str]:
    """Returns the ids of the flow runs that were ended; without a server, or without such runs, Prefect stays out."""
    with known_server() as api_url:
        if not api_url or not any(run.detail.get(FLOW_RUN) for run in records(store, KIND)):
            return []

        from flows.prefect.flow_runs import end_abandoned_flow_runs  # noqa: PLC0415 - Prefect, where it has something to end

        return end_abandoned_flow_runs(store)
