"""The commands `simyard describe`, `list`, `cancel` and `restart`, and `gc` and `reap`, which clean up a store."""
# ruff: noqa: PLC0415 - see above
# ruff: noqa: PLC0415 - what a command needs is imported when it runs

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import JsonValue
from rich.console import Console
from rich.table import Table

from flows.cli.terminal import TerminalConsole, echo, echo_json, json_lines, page_rows, show_rows
from flows.resources.kinds import KINDS

if TYPE_CHECKING:
    from tasks.housekeeping.job import FindingRow, GcReport
    from tasks.housekeeping.machine import MachineReport, MachineRow
    from tasks.storage.base.store import Store

_KINDS = ", ".join(kind.plural for kind in KINDS.values())
StoreUrl = Annotated[
    str | None,
    typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
]


def describe(
    arns: Annotated[
        list[str],
        typer.Argument(metavar="NAME...", help="What `simyard run` or `simyard list` printed: an ARN, an id, a name."),
    ],
    store: StoreUrl = None,
) -> None:
    """Print what RoboMaker's Describe call answers, as JSON; for several jobs, BatchDescribeSimulationJob's answer."""
    from flows.resources.abandoned_jobs import job_notes
    from flows.resources.kinds import describe_jobs, describe_resource
    from specs.arn import resource_kind, resource_name
    from tasks.simulate.batch.batch_jobs import batch_notes
    from tasks.simulate.batch.metrics import metric_lines
    from tasks.storage.resource_names import resource_arn
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    if len(arns) > 1:
        echo_json(describe_jobs(opened, arns).model_dump_json(indent=2, exclude_none=True))
        return
    arn = resource_arn(opened, arns[0])
    echo_json(describe_resource(opened, arn).model_dump_json(indent=2, exclude_none=True))
    for line in (*batch_notes(opened, arn), *metric_lines(opened, arn)):
        echo(line, err=True)
    if resource_kind(arn) == "deployment-job":
        from flows.cli.fleet_watch import wish_notes

        for line in wish_notes(opened, resource_name(arn)):  # what RoboMaker's shapes have no field for
            echo(line, err=True)
    for note in job_notes(opened, arn):
        echo(note, err=True)


def cancel(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="The ARN or id of a job, a batch, or a whole run of a document.")
    ],
    store: StoreUrl = None,
) -> None:
    """Cancel a job; what is done is kept, and who works on it stops within seconds."""
    from flows.resources.kinds import cancel_resource as cancel_named
    from specs.arn import resource_kind
    from tasks.storage.resource_names import resource_arn
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    arn = resource_arn(opened, name)
    cancel_named(opened, arn)
    echo(f"canceling {name}")
    if resource_kind(arn) == "deployment-job":
        from flows.resources.fleet_membership import withdrawal_notes

        for line in withdrawal_notes(opened, arn):
            echo(line, err=True)


def restart(
    name: Annotated[
        str, typer.Argument(metavar="JOB", help="The ARN of a simulation job that is running, or <batch>/<index>.")
    ],
    store: StoreUrl = None,
) -> None:
    """Restart a running job: it is simulated once more, with the bundles of its batch."""
    from flows.resources.kinds import restart_named_job as restart_named
    from tasks.storage.store_url import open_existing_store

    restart_named(open_existing_store(store), name)
    echo(f"restarting {name}")


def list_(
    kind: Annotated[str | None, typer.Argument(help=_KINDS, show_default=False)] = None,
    *,
    store: StoreUrl = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON document a line; of a page, RoboMaker's answer.")
    ] = False,
    max_results: Annotated[int | None, typer.Option(help="List one page of at most so many.")] = None,
    next_token: Annotated[str | None, typer.Option(help="List the page that the page before it named.")] = None,
    filters: Annotated[
        list[str] | None,
        typer.Option(
            "--filter",
            metavar="NAME=VALUE",
            help="List a page of what fits, such as status=Failed; of one name, any one suffices.",
        ),
    ] = None,
) -> None:
    """List what a store holds of one kind, oldest first: all, or a page, filtered if you wish."""
    if kind is None:
        raise typer.BadParameter(f"say what to list, one of {_KINDS}", param_hint="KIND")
    from flows.resources.abandoned_jobs import kind_notes
    from flows.resources.kinds import list_page, list_resources
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    token: str | None = None
    if request := _page_request(max_results, next_token, filters or []):
        page = list_page(opened, kind, request)
        lines, (rows, token) = list(json_lines([page])), page_rows(page)
    else:
        lines = list(json_lines(list_resources(opened, kind)))
        rows = [json.loads(line) for line in lines] if not as_json else []
    if as_json:
        for line in lines:
            echo_json(line)
    else:
        show_rows(_with_columns(opened, kind, rows), TerminalConsole())
    if token:
        echo(f"the next page: --next-token {token}", err=True)
    for note in kind_notes(opened, kind):
        echo(note, err=True)


def _with_columns(store: "Store", kind: str, rows: list[dict[str, JsonValue]]) -> list[dict[str, JsonValue]]:
    """Returns the rows; those of batches with what RoboMaker's shapes have no field for, behind the ARN."""
    if kind != KINDS["simulation-job-batch"].plural:
        return rows
    from flows.resources.run_pages import batch_columns

    known = batch_columns(store, [str(row["arn"]) for row in rows])
    return [{"arn": row.get("arn"), **known.get(str(row.get("arn")), {}), **row} for row in rows]


def _page_request(max_results: int | None, next_token: str | None, filters: list[str]) -> dict[str, JsonValue]:
    """Returns the request that the options of `simyard list` make; empty if the list is wanted as a whole."""
    pairs = [text.partition("=") for text in filters]
    request: dict[str, JsonValue] = {
        "maxResults": max_results,
        "nextToken": next_token,
        "filters": [{"name": name, "values": [value]} for name, _, value in pairs] or None,
    }
    return {name: value for name, value in request.items() if value is not None}


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
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Tell what no record of a store names, and what this machine's cache can spare; with --yes, remove it.

    Records that cannot be read end it with 3: what they might name stays.
    """
    from tasks.housekeeping.job import Ages, collect_garbage
    from tasks.storage.base.local_files import cache_folder
    from tasks.storage.store_url import open_existing_store

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
    from tasks.housekeeping.machine import clean_machine

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
        from specs.errors import DocumentError

        raise DocumentError.of(option, repr(text), "a number and s, m, h, d or w, such as 24h", source="simyard")
    return float(int(found[1]) * _SECONDS[found[2]])


def reap(
    *,
    outdated: Annotated[
        bool, typer.Option("--outdated", help="Cancel runs whose document was changed and has ended since, too.")
    ] = False,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Tell which jobs nobody works on; end those that were being stopped, and ready the others to be run on.

    Flow runs whose process died become Crashed on the Prefect server of PREFECT_API_URL, else of simyard up, if one
    answers. With keys (SIMYARD_KEYS), also keeps what they have signed from expiring.
    """
    from flows.resources.abandoned_jobs import reap_jobs as reap_store
    from flows.resources.abandoned_jobs import under_way
    from flows.resources.fleet_membership import renew_metadata_here
    from tasks.storage.store_url import open_existing_store

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
    from flows.prefect.prefect_server import known_server
    from tasks.storage.jobs.records import records
    from tasks.storage.jobs.runs import FLOW_RUN, KIND

    with known_server() as api_url:
        if not api_url or not any(run.detail.get(FLOW_RUN) for run in records(store, KIND)):
            return []
        from flows.prefect.flow_runs import end_abandoned_flow_runs

        return end_abandoned_flow_runs(store)
