"""The commands `simyard describe`, `list`, `cancel` and `restart`."""

import json
from typing import Annotated

import typer
from pydantic import JsonValue

from flows.cli.fleet_watch import wish_notes
from flows.cli.terminal import StoreUrl, TerminalConsole, echo, echo_json, json_lines, page_rows, show_rows
from flows.resources.abandoned_jobs import job_notes, kind_notes
from flows.resources.kinds import KINDS, describe_jobs, describe_resource, list_page, list_resources
from flows.resources.kinds import cancel_resource as cancel_named
from flows.resources.kinds import restart_named_job as restart_named
from flows.resources.run_lists import batch_columns
from specs.arn import resource_kind, resource_name
from tasks.simulate.batch.batch_jobs import batch_notes
from tasks.simulate.batch.metrics import metric_lines
from tasks.storage.base.store import Store
from tasks.storage.resource_names import resource_arn
from tasks.storage.store_url import open_existing_store

_KINDS = ", ".join(kind.plural for kind in KINDS.values())


def describe(
    arns: Annotated[
        list[str],
        typer.Argument(metavar="NAME...", help="What `simyard run` or `simyard list` printed: an ARN, an id, a name."),
    ],
    store: StoreUrl = None,
) -> None:
    """Print what RoboMaker's Describe call answers, as JSON; for several jobs, BatchDescribeSimulationJob's answer."""
    opened = open_existing_store(store)
    if len(arns) > 1:
        echo_json(describe_jobs(opened, arns).model_dump_json(indent=2, exclude_none=True))
        return
    arn = resource_arn(opened, arns[0])
    echo_json(describe_resource(opened, arn).model_dump_json(indent=2, exclude_none=True))
    for line in (*batch_notes(opened, arn), *metric_lines(opened, arn)):
        echo(line, err=True)
    if resource_kind(arn) == "deployment-job":
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
    opened = open_existing_store(store)
    arn = resource_arn(opened, name)
    cancel_named(opened, arn)
    echo(f"canceling {name}")
    if resource_kind(arn) == "deployment-job":
        from flows.resources.fleet_membership import withdrawal_notes  # noqa: PLC0415 - signatures, which others lack

        for line in withdrawal_notes(opened, arn):
            echo(line, err=True)


def restart(
    name: Annotated[
        str, typer.Argument(metavar="JOB", help="The ARN of a simulation job that is running, or <batch>/<index>.")
    ],
    store: StoreUrl = None,
) -> None:
    """Restart a running job: it is simulated once more, with the bundles of its batch."""
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
    elif rows:
        show_rows(_with_columns(opened, kind, rows), TerminalConsole())
    else:
        echo(_nothing_found(kind, filters or []), err=True)
    if token:
        echo(f"the next page: --next-token {token}", err=True)
    for note in kind_notes(opened, kind):
        echo(note, err=True)


def _nothing_found(kind: str, filters: list[str]) -> str:
    """Returns that there is nothing to list; of jobs that failed, where those are that ended and did not pass."""
    said = f"there are no {kind}{' that fit the filter' if filters else ''}"
    if kind == KINDS["simulation-job"].plural and "status=Failed" in filters:
        why = "a job that drove its episode to the end is Completed, passed or not, and Failed is one that crashed"
        return f"{said}: {why}; simyard report BATCH shows the episodes that did not pass"
    return said


def _with_columns(store: "Store", kind: str, rows: list[dict[str, JsonValue]]) -> list[dict[str, JsonValue]]:
    """Returns the rows; those of batches with what RoboMaker's shapes have no field for, behind the ARN."""
    if kind != KINDS["simulation-job-batch"].plural:
        return rows

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
