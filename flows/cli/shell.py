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
from rich.console import Console

from flows.cli.app_commands import app_app
from flows.cli.batch_commands import compare, replay, report, shrink
from flows.cli.exit_codes import leave_process_after
from flows.cli.fleet_commands import fleet_app
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
    leave_process_after(_logged)


def _logged() -> None:
    from tasks.progress.log_lines import logging_as_asked

    with logging_as_asked():
        app()


@app.command()
def run(file: Document, store: StoreUrl = None) -> None:
    """Run a document from its first section to its last; continues a run that was killed."""
    from flows.cli.output import show_report
    from flows.cli.run_command import run_document
    from tasks.documents.pipeline_file import read_pipeline

    console, spec = Console(), read_pipeline(file)
    try:
        with _about(file):
            report = run_document(spec, file.resolve().parent, store, console)
    except PipelineNotPassed as exc:
        show_report(exc.report, console)
        raise typer.Exit(1) from exc
    show_report(report, console)


@app.command()
def plan(file: Document, store: StoreUrl = None) -> None:
    """Tell what a run of the document would do, and what in it has no effect."""
    from flows.preview.plan import planned
    from tasks.documents.pipeline_file import read_pipeline
    from tasks.storage.store_url import open_store

    spec = read_pipeline(file)
    with _about(file):
        for line in planned(spec, file.resolve().parent, open_store(store)):
            typer.echo(line)


@app.command()
def validate(file: Document) -> None:
    """Check a document and tell all its faults at once."""
    from tasks.documents.pipeline_file import read_pipeline

    spec = read_pipeline(file)
    typer.echo(f"{file}: {spec.name}: valid")


@app.command()
def describe(
    arns: Annotated[list[str], typer.Argument(metavar="ARN...", help="What `simyard run` or `simyard list` printed.")],
    store: StoreUrl = None,
) -> None:
    """Print what RoboMaker's Describe call answers, as JSON; for several ARNs, BatchDescribeSimulationJob's answer."""
    from flows.resource.abandoned_jobs import described_notes
    from flows.resource.answers import described, described_together
    from specs.arn import parse_reference
    from tasks.simulate.batch.metrics import told_metrics
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    answer = described(opened, arns[0]) if len(arns) == 1 else described_together(opened, arns)
    typer.echo(answer.model_dump_json(indent=2, exclude_none=True))
    for line in told_metrics(opened, arns[0]) if len(arns) == 1 else ():
        typer.echo(line, err=True)
    if len(arns) == 1 and ":deployment-job" in arns[0]:
        from flows.cli.fleet_watch import told_wish

        for line in told_wish(opened, parse_reference(arns[0]).path):  # what RoboMaker's shapes have no field for
            typer.echo(line, err=True)
    for note in described_notes(opened, arns[0]) if len(arns) == 1 else ():
        typer.echo(note, err=True)


@app.command()
def cancel(
    arn: Annotated[str, typer.Argument(help="The ARN of a job, a batch, or a whole run of a document.")],
    store: StoreUrl = None,
) -> None:
    """Cancel a job; what is done is kept, and who works on it stops within seconds."""
    from flows.resource.cancel import cancel as cancel_named
    from tasks.storage.store_url import open_existing_store

    cancel_named(open_existing_store(store), arn)
    typer.echo(f"canceling {arn}")


@app.command()
def restart(
    arn: Annotated[str, typer.Argument(help="The ARN of a simulation job that is running.")],
    store: StoreUrl = None,
) -> None:
    """Restart a running job: it is simulated once more, with the bundles of its batch."""
    from flows.resource.answers import restart as restart_named
    from tasks.storage.store_url import open_existing_store

    restart_named(open_existing_store(store), arn)
    typer.echo(f"restarting {arn}")


@app.command("list")
def list_(
    kind: Annotated[str, typer.Argument(help=_KINDS)],
    store: StoreUrl = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document a line.")] = False,  # noqa: FBT002 - a switch
) -> None:
    """List what a store holds of one kind."""
    from flows.cli.output import json_lines, show_rows
    from flows.resource.abandoned_jobs import listed_notes
    from flows.resource.answers import listed
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    lines = list(json_lines(listed(opened, kind)))
    if as_json:
        for line in lines:
            typer.echo(line)
    else:
        show_rows([json.loads(line) for line in lines], Console())
    for note in listed_notes(opened, kind):
        typer.echo(note, err=True)


@app.command()
def up() -> None:
    """Start a Prefect server that stays; `simyard run` uses it."""
    from flows.cli.run_command import prefect_home
    from tasks.server.resident import keep

    server = keep(prefect_home())
    typer.echo(f"Prefect: {server.api_url.removesuffix('/api')}  (log: {server.log})")
    typer.echo(f"export PREFECT_API_URL={server.api_url}")


@app.command()
def down() -> None:
    """End the server that `simyard up` started."""
    from flows.cli.run_command import prefect_home
    from tasks.server.resident import end_kept

    server = end_kept(prefect_home())
    typer.echo(f"ended {server.api_url}" if server else "no server was running")


@app.command(  # --help is the agent's own
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
)
def agent(context: typer.Context) -> None:
    """Run a robot's agent: --robot NAME --root DIR --store URL --root-of-trust FILE (or --unsigned)."""
    from tasks.deploy.robot.agent import main as agent_main

    raise typer.Exit(agent_main(context.args))


@contextmanager
def _about(file: Path) -> Generator[None, None, None]:
    """Names the file in the faults of what its document refers to."""
    try:
        yield
    except DocumentError as exc:
        raise type(exc)(exc.faults, str(file)) from exc


if __name__ == "__main__":
    main()
