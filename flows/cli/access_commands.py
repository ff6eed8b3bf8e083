"""The commands of `simyard access`: who may call `simyard serve`. Each imports what it needs when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.output import echo

access_app = typer.Typer(
    help="Make, list and revoke the keys of clients of `simyard serve`, and read who did what.", no_args_is_help=True
)
_Name = Annotated[str, typer.Argument(metavar="NAME", help="The key's name.", show_default=False)]
_File = Annotated[
    Path | None,
    typer.Option(
        "--access-keys",
        envvar="SIMYARD_ACCESS_FILE",
        help="The file with the keys. Default: ~/.config/simyard/access-keys.",
        show_default=False,
    ),
]
_Url = Annotated[
    str,
    typer.Option("--url", envvar="AWS_ENDPOINT_URL_ROBOMAKER", help="The address of `simyard serve`."),
]


@access_app.command("add")
def add(
    name: _Name,
    rights: Annotated[
        list[str],
        typer.Option("--right", metavar="RIGHT", help="read, simulate or deploy; several times for several."),
    ],
    on: Annotated[
        list[str] | None,
        typer.Option(
            "--on",
            metavar="ARN",
            help="Only this: an ARN or KIND/NAME, with * at its end for all that begin so; several times for several.",
            show_default=False,
        ),
    ] = None,
    url: _Url = "http://127.0.0.1:8600",
    file: _File = None,
) -> None:
    """Make a key, and print what its client needs, the secret included, as lines for a shell."""
    from flows.gateway.client_environment import export_lines
    from tasks.gateway.access.key_file import access_file, add_key

    for line in export_lines(add_key(file or access_file(), name, rights, on or ()), url):
        echo(line)


@access_app.command("list")
def list_(file: _File = None) -> None:
    """Show the keys, their rights and limits, and no secret."""
    from rich.console import Console

    from flows.cli.output import show_rows
    from tasks.gateway.access.key_file import access_file, read_keys

    keys = read_keys(file or access_file()).values()
    rows = [
        {
            "name": key.name,
            "key": key.key_id,
            "rights": " ".join(sorted(key.rights)),
            "on": " ".join(scope.text for scope in key.scopes) or "everything",
        }
        for key in keys
    ]
    show_rows(rows, Console())


@access_app.command("export")
def export(name: _Name, url: _Url = "http://127.0.0.1:8600", file: _File = None) -> None:
    """Print what the client of a key needs, the secret included, as lines for a shell."""
    from flows.gateway.client_environment import export_lines
    from tasks.gateway.access.key_file import access_file, find_key, read_keys

    path = file or access_file()
    for line in export_lines(find_key(read_keys(path), name, path), url):
        echo(line)


@access_app.command("revoke")
def revoke(name: _Name, file: _File = None) -> None:
    """Remove a key: a gateway that runs refuses it from its next request on."""
    from tasks.gateway.access.key_file import access_file, revoke_key

    key = revoke_key(file or access_file(), name)
    echo(f"revoked {key.name} ({key.key_id})")


@access_app.command("log")
def log(
    days: Annotated[int, typer.Option("--days", min=1, max=3650, help="Of how many days, today's among them.")] = 1,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Print who changed what over HTTP, and who was refused, of all gateways of the store: a line of JSON each."""
    import time

    from flows.cli.output import echo_json
    from tasks.gateway.access.action_log import actions
    from tasks.storage.store_url import open_existing_store

    for line in actions(open_existing_store(store), days, time.time()):
        echo_json(line)
