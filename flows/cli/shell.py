"""The command line, `simyard`.

Exit codes: see `flows.cli.terminal`. The module of a command is imported when the command is called, so that `--help`
loads none of them, and `validate` and `describe` neither JAX nor Prefect.
"""

import os
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import version as version_of
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from flows.cli.terminal import echo
from specs.settings import TRUST_APPLICATIONS


class LazyCommand(NamedTuple):
    """A command, or a group of commands, whose module is not imported yet.

    Attributes:
        module: In `flows.cli`.
        name: Of the function or the group there.
        help: The first line of its help, which a test holds against the module's.
    """

    module: str
    name: str
    help: str


# In the order in which --help lists them.
COMMANDS: Mapping[str, LazyCommand] = {
    "run": LazyCommand(
        "document_commands",
        "run",
        "Run a document from its first section to its last; continues a run that was killed.",
    ),
    "plan": LazyCommand(
        "document_commands", "plan", "Tell what a run of the document would do, and what in it has no effect."
    ),
    "validate": LazyCommand(
        "document_commands", "validate", "Check a document, or a template alone, and tell all its faults at once."
    ),
    "gate": LazyCommand(
        "batch_commands",
        "gate",
        "Judge a batch that has ended by a document's gate, without simulating; 0 PASS, 1 FAIL, 4 INCONCLUSIVE.",
    ),
    "report": LazyCommand(
        "batch_commands",
        "report",
        "Write the report of a batch, one HTML file that needs nothing but itself, and print where it is.",
    ),
    "trend": LazyCommand("batch_commands", "trend", "Show a document's rates night by night, and where they changed."),
    "replay": LazyCommand(
        "replay_commands",
        "replay",
        "Simulate an episode once more, compare it bit for bit with its record, and draw it; 1 if it deviates.",
    ),
    "compare": LazyCommand(
        "replay_commands",
        "compare",
        "Compare two batches over the episodes that both have; 0: B is no worse than A; 1: worse; 4: not shown.",
    ),
    "shrink": LazyCommand(
        "replay_commands",
        "shrink",
        "Find the smallest world and the lowest seed in which a job still fails in the same way; write them as a case.",
    ),
    "suite": LazyCommand(
        "replay_commands",
        "suite",
        "Write the failures that a document's search has found and confirmed as a document that drives them again.",
    ),
    "describe": LazyCommand(
        "resource_commands",
        "describe",
        "Print what RoboMaker's Describe call answers, as JSON; for several jobs, BatchDescribeSimulationJob's answer.",
    ),
    "cancel": LazyCommand(
        "resource_commands", "cancel", "Cancel a job; what is done is kept, and who works on it stops within seconds."
    ),
    "restart": LazyCommand(
        "resource_commands",
        "restart",
        "Restart a running job: it is simulated once more, with the bundles of its batch.",
    ),
    "list": LazyCommand(
        "resource_commands",
        "list_",
        "List what a store holds of one kind, oldest first: all, or a page, filtered if you wish.",
    ),
    "serve": LazyCommand(
        "server_commands",
        "serve",
        "Answer RoboMaker's HTTP API from a store, for boto3, the AWS CLI and scripts, until Ctrl-C.",
    ),
    "worker": LazyCommand(
        "server_commands",
        "worker",
        "Work off the jobs that calls of RoboMaker's API have put into a store's queue, until Ctrl-C.",
    ),
    "gc": LazyCommand(
        "store_commands",
        "gc",
        "Tell what no record of a store names, and what this machine's cache can spare; with --yes, remove it.",
    ),
    "reap": LazyCommand(
        "store_commands",
        "reap",
        "Tell which jobs nobody works on; end those that were being stopped, and ready the others to be run on.",
    ),
    "up": LazyCommand(
        "server_commands",
        "up",
        'Start a Prefect server that stays; `simyard run` uses it, and `eval "$(simyard up)"` lets `prefect` use it.',
    ),
    "down": LazyCommand("server_commands", "down", "End the server that `simyard up` started."),
    "app": LazyCommand("app_commands", "app_app", "Make applications and publish their versions."),
    "world": LazyCommand("world_commands", "world_app", "Look at worlds."),
    "fleet": LazyCommand("fleet_commands", "fleet_app", "Make fleets and put robots into them."),
    "access": LazyCommand(
        "server_commands",
        "access_app",
        "Make, list and revoke the keys of clients of `simyard serve`, and read who did what.",
    ),
}


def load(name: str) -> Any:  # noqa: ANN401 - a command of the parser's, whose class is private
    """Returns a command, its module being imported."""
    lazy = COMMANDS[name]
    found = getattr(import_module(f"flows.cli.{lazy.module}"), lazy.name)
    if isinstance(found, typer.Typer):
        group = get_group(found)
        group.name = name
        return group
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(name)(found)
    return get_command(alone)


class LazyShell(TyperGroup):
    """The commands of the shell, beside `agent`, which robots call: it is imported with the shell."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ANN401, ARG002 - the parser's
        """Returns the names of all commands, in their order."""
        return [*COMMANDS, "agent"]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ANN401 - the parser's
        """Returns a command, its module being imported."""
        if cmd_name in self.commands or cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        return load(cmd_name)

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - the parser's
        """Writes the help, for which no command is imported."""
        self._name_commands()
        super().format_help(ctx, formatter)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - the parser's
        """Returns the command that is called; for one that there is not, the answer names those that are alike."""
        if args and args[0] not in COMMANDS:
            self._name_commands()
        return super().resolve_command(ctx, args)

    def _name_commands(self) -> None:
        for name, lazy in COMMANDS.items():
            self.commands.setdefault(name, TyperCommand(name, help=lazy.help))


app = typer.Typer(
    cls=LazyShell,
    help="From a world template to a tested fleet.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)


def _show_version(wanted: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if wanted:
        echo(f"simyard {version_of('simyard')}")
        raise typer.Exit


def _trust_applications(wanted: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if wanted:
        os.environ[TRUST_APPLICATIONS] = "1"


@app.callback()
def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    trust_applications: Annotated[
        bool,
        typer.Option(
            "--trust-applications",
            callback=_trust_applications,
            help="Run all applications, also where nothing shuts them in and there are keys.",
        ),
    ] = False,
) -> None:
    """From a world template to a tested fleet."""


@app.command(  # --help is the agent's own
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
)
def agent(context: typer.Context) -> None:
    """Run a robot's agent: --robot NAME --root DIR --store URL --root-of-trust FILE (or --unsigned)."""
    from tasks.deploy.robot.agent import main as agent_main  # noqa: PLC0415 - only a robot has it

    raise typer.Exit(agent_main(context.args))
