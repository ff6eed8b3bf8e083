"""The command line, `simyard`.

Exit codes: see flows.cli.exit_codes.
What a command needs is imported when it runs, so that `--help`, `validate` and `describe` load neither JAX nor Prefect.
"""
# ruff: noqa: PLC0415 - see above

import json
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from pydantic import JsonValue

from flows.cli.app_commands import app_app
from flows.cli.batch_commands import compare, replay, report, shrink
from flows.cli.exit_codes import run_and_end_process
from flows.cli.fleet.fleet_commands import fleet_app
from flows.cli.output import TerminalConsole, echo, echo_json, json_lines, page_rows, show_report, show_rows
from flows.cli.store_commands import gc, reap
from flows.cli.world_commands import world_app
from flows.resource.kinds import KINDS
from specs.errors import DocumentError, PipelineNotPassed

app = typer.Typer(
    help="From a world template to a tested fleet.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.add_typer(app_app, name="app")
app.add_typer(world_app, name="world")
app.add_typer(fleet_app, name="fleet")
app.command()(report)
app.command()(replay)
app.command()(compare)
app.command()(shrink)
app.command()(reap)
app.command()(gc)

_KINDS = ", ".join(kind.plural for kind in KINDS.values())
Document = Annotated[Path, typer.Argument(help="The pipeline document, YAML or JSON.", show_default=False)]
StoreUrl = Annotated[
    str | None,
    typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
]


def main() -> None:
    """Runs the command line and exits with Simyard's codes."""
    run_and_end_process(_run_app)


def _run_app() -> None:
    from tasks.progress.log_lines import log_in_chosen_format

    with log_in_chosen_format():
        app()


@app.command()
def run(
    file: Document,
    *,
    store: StoreUrl = None,
    direct: Annotated[
        bool, typer.Option("--direct", help="Without a Prefect server: no pages, artifacts, events, or other workers.")
    ] = False,
) -> None:
    """Run a document from its first section to its last; continues a run that was killed."""
    from tasks.documents.pipeline_file import read_pipeline

    console, spec = TerminalConsole(), read_pipeline(file)
    try:
        with _name_file(file):
            if direct:
                from flows.cli.direct_command import run_directly as run_document
            else:
                from flows.cli.run_command import run_document
            report = run_document(spec, file.resolve().parent, store, console)
    except PipelineNotPassed as exc:
        show_report(exc.report, console)
        raise typer.Exit(1) from exc
    show_report(report, console)


@app.command()
def plan(file: Document, store: StoreUrl = None) -> None:
    """Tell what a run of the document would do, and what in it has no effect."""
    from flows.preview.plan import plan_lines
    from tasks.documents.pipeline_file import read_pipeline
    from tasks.storage.store_url import open_store

    spec = read_pipeline(file)
    with _name_file(file):
        for line in plan_lines(spec, file.resolve().parent, open_store(store)):
            echo(line)


@app.command()
def validate(file: Document) -> None:
    """Check a document and tell all its faults at once."""
    from flows.document.robot_files import check_robot_files
    from tasks.documents.pipeline_file import read_pipeline

    spec = read_pipeline(file)
    with _name_file(file):
        check_robot_files(spec, file.resolve().parent)
    echo(f"{file}: {spec.name}: valid")


@app.command()
def describe(
    arns: Annotated[list[str], typer.Argument(metavar="ARN...", help="What `simyard run` or `simyard list` printed.")],
    store: StoreUrl = None,
) -> None:
    """Print what RoboMaker's Describe call answers, as JSON; for several ARNs, BatchDescribeSimulationJob's answer."""
    from flows.resource.abandoned_jobs import job_notes
    from flows.resource.answers import describe_jobs, describe_resource
    from specs.arn import resource_kind, resource_name
    from tasks.simulate.batch.metrics import metric_lines
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    answer = describe_resource(opened, arns[0]) if len(arns) == 1 else describe_jobs(opened, arns)
    echo_json(answer.model_dump_json(indent=2, exclude_none=True))
    for line in metric_lines(opened, arns[0]) if len(arns) == 1 else ():
        echo(line, err=True)
    if len(arns) == 1 and resource_kind(arns[0]) == "deployment-job":
        from flows.cli.fleet.fleet_watch import wish_notes

        for line in wish_notes(opened, resource_name(arns[0])):  # what RoboMaker's shapes have no field for
            echo(line, err=True)
    for note in job_notes(opened, arns[0]) if len(arns) == 1 else ():
        echo(note, err=True)


@app.command()
def cancel(
    arn: Annotated[str, typer.Argument(help="The ARN of a job, a batch, or a whole run of a document.")],
    store: StoreUrl = None,
) -> None:
    """Cancel a job; what is done is kept, and who works on it stops within seconds."""
    from flows.resource.cancel import cancel_resource as cancel_named
    from specs.arn import resource_kind
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    cancel_named(opened, arn)
    echo(f"canceling {arn}")
    if resource_kind(arn) == "deployment-job":
        from flows.resource.withdrawal import withdrawal_notes

        for line in withdrawal_notes(opened, arn):
            echo(line, err=True)


@app.command()
def restart(
    arn: Annotated[str, typer.Argument(help="The ARN of a simulation job that is running.")],
    store: StoreUrl = None,
) -> None:
    """Restart a running job: it is simulated once more, with the bundles of its batch."""
    from flows.resource.answers import restart_named_job as restart_named
    from tasks.storage.store_url import open_existing_store

    restart_named(open_existing_store(store), arn)
    echo(f"restarting {arn}")


@app.command("list")
def list_(
    kind: Annotated[str, typer.Argument(help=_KINDS)],
    *,
    store: StoreUrl = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON document a line; of a page, RoboMaker's answer.")
    ] = False,
    max_results: Annotated[int | None, typer.Option(min=1, help="List one page of at most so many.")] = None,
    next_token: Annotated[str | None, typer.Option(help="List the page that the page before it named.")] = None,
    filters: Annotated[
        list[str] | None,
        typer.Option(
            "--filter", metavar="NAME=VALUE", help="List a page of what fits, such as status=Failed; any one suffices."
        ),
    ] = None,
) -> None:
    """List what a store holds of one kind: all, or a page of fleets, robots, deployments, batches or their jobs."""
    from flows.resource.abandoned_jobs import kind_notes
    from flows.resource.answers import list_page, list_resources
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
        show_rows(rows, TerminalConsole())
    if token:
        echo(f"the next page: --next-token {token}", err=True)
    for note in kind_notes(opened, kind):
        echo(note, err=True)


@app.command()
def up() -> None:
    """Start a Prefect server that stays; `simyard run` uses it, and `eval "$(simyard up)"` lets `prefect` use it."""
    import shlex

    from flows.cli.run_command import prefect_home
    from tasks.server.password import password_file
    from tasks.server.resident import keep

    home = prefect_home()
    server, password = keep(home), shlex.quote(str(password_file(home)))
    # A shell takes all of it: eval "$(simyard up)"
    echo(f"# Prefect: {server.api_url.removesuffix('/api')}  (log: {server.log})")
    echo(f"# its pages ask for the password in {password}")
    echo(f"export PREFECT_API_URL={server.api_url}")
    echo(f'export PREFECT_API_AUTH_STRING="$(cat {password})"')


@app.command()
def down() -> None:
    """End the server that `simyard up` started."""
    from flows.cli.run_command import prefect_home
    from tasks.server.resident import end_kept

    server = end_kept(prefect_home())
    echo(f"ended {server.api_url}" if server else "no server was running")


@app.command(  # --help is the agent's own
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
)
def agent(context: typer.Context) -> None:
    """Run a robot's agent: --robot NAME --root DIR --store URL --root-of-trust FILE (or --unsigned)."""
    from tasks.deploy.robot.agent import main as agent_main

    raise typer.Exit(agent_main(context.args))


def _page_request(max_results: int | None, next_token: str | None, filters: list[str]) -> dict[str, JsonValue]:
    """Returns the request that the options of `simyard list` make; empty if the list is wanted as a whole."""
    pairs = [text.partition("=") for text in filters]
    request: dict[str, JsonValue] = {
        "maxResults": max_results,
        "nextToken": next_token,
        "filters": [{"name": name, "values": [value]} for name, _, value in pairs] or None,
    }
    return {name: value for name, value in request.items() if value is not None}


@contextmanager
def _name_file(file: Path) -> Generator[None, None, None]:
    """Names the file in the faults of what its document refers to."""
    try:
        yield
    except DocumentError as exc:
        raise type(exc)(exc.faults, str(file)) from exc


if __name__ == "__main__":
    main()
