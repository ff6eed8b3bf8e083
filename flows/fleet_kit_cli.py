"""`simyard fleet agent-kit`: what one carries to a robot. Thin; what it needs is imported when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer


def agent_kit(
    folder: Annotated[Path, typer.Argument(help="Where to; made if it is missing.", show_default=False)],
    keys: Annotated[
        Path | None,
        typer.Option(
            "--keys", envvar="SIMYARD_KEYS", help="The folder of simyard fleet keys init.", show_default=False
        ),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
    unsigned: Annotated[bool, typer.Option("--unsigned", help="For robots that verify nothing.")] = False,  # noqa: FBT002 - a switch
) -> None:
    """Write what a robot needs: the agent, an installer, a systemd unit, the store's URL and the root of trust."""
    from specs.base import Fault
    from specs.errors import DocumentError
    from tasks.deploy.kit.files import write_kit
    from tasks.deploy.trust.keyring import ROOT_FILE
    from tasks.storage.opening import open_existing_store

    root = None if unsigned or keys is None else keys / ROOT_FILE
    if not unsigned and (root is None or not root.is_file()):
        allowed = "the folder of simyard fleet keys init; or --unsigned, for robots that run whatever is in the store"
        raise DocumentError([Fault(path="--keys", value=str(keys or ""), allowed=allowed)])
    opened = open_existing_store(store)
    for path in write_kit(folder, store_url=opened.url, root_of_trust=root.read_bytes() if root else None):
        typer.echo(path)
    typer.echo(f"on each robot, from a copy of {folder}: sudo ./install.sh NAME")
