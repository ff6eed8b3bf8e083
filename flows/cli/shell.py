"""The command line, `simyard`.

Exit codes: see flows.cli.terminal.
What a command needs is imported when it runs, so that `--help`, `validate` and `describe` load neither JAX nor Prefect.
"""
# ruff: noqa: PLC0415 - see above

from typing import Annotated

import typer

from flows.cli.app_commands import app_app
from flows.cli.batch_commands import compare, gate, replay, report, shrink, trend
from flows.cli.document_commands import plan, run, validate
from flows.cli.fleet_commands import fleet_app
from flows.cli.server_commands import access_app, down, serve, up, worker
from flows.cli.store_commands import cancel, describe, gc, list_, reap, restart
from flows.cli.terminal import echo, run_and_end_process
from flows.cli.world_commands import world_app

app = typer.Typer(
    help="From a world template to a tested fleet.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.add_typer(app_app, name="app")
app.add_typer(world_app, name="world")
app.add_typer(fleet_app, name="fleet")
app.add_typer(access_app, name="access")


def _show_version(wanted: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if wanted:
        from importlib.metadata import version

        echo(f"simyard {version('simyard')}")
        raise typer.Exit


@app.callback()
def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """From a world template to a tested fleet."""


# In the order in which --help lists them.
for command in (run, plan, validate, gate, report, trend, replay, compare, shrink, describe, cancel, restart):
    app.command()(command)
app.command("list")(list_)
for command in (serve, worker, gc, reap, up, down):
    app.command()(command)


def main() -> None:
    """Runs the command line and exits with Simyard's codes."""
    run_and_end_process(_run_app)


def _run_app() -> None:
    from tasks.progress.log_lines import log_in_chosen_format

    with log_in_chosen_format():
        app()


@app.command(  # --help is the agent's own
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
)
def agent(context: typer.Context) -> None:
    """Run a robot's agent: --robot NAME --root DIR --store URL --root-of-trust FILE (or --unsigned)."""
    from tasks.deploy.robot.agent import main as agent_main

    raise typer.Exit(agent_main(context.args))


if __name__ == "__main__":
    main()
