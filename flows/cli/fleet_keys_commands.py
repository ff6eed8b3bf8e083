"""The commands of `simyard fleet keys`, which manage signing keys. Each imports what it needs when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.output import echo

keys_app = typer.Typer(help="Make, renew and replace the keys that vouch for deployments.", no_args_is_help=True)

_Keys = Annotated[
    Path,
    typer.Option(
        "--keys", envvar="SIMYARD_KEYS", help="The folder with the private keys, outside the store.", show_default=False
    ),
]
_StoreUrl = Annotated[
    str | None,
    typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
]


@keys_app.command("init")
def init(keys: _Keys, store: _StoreUrl = None) -> None:
    """Make the keys in the folder, and their metadata in the store; what is there stays. Prints the root of trust."""
    from tasks.deploy.trust.keyring import ROOT_FILE
    from tasks.deploy.trust.repository import init_keys
    from tasks.storage.store_url import open_store

    ring = init_keys(open_store(store), keys)
    echo(f"{ring.folder / ROOT_FILE}: give it to each robot: simyard agent --root-of-trust {ROOT_FILE}")
    echo("root-*.pem and targets-*.pem are only needed to replace a key: keep them offline")


@keys_app.command("rotate")
def rotate(
    roles: Annotated[
        list[str],
        typer.Argument(metavar="ROLE...", help="root, targets, deployer, snapshot, timestamp.", show_default=False),
    ],
    keys: _Keys,
    store: _StoreUrl = None,
) -> None:
    """Replace keys, as after a theft: what the old ones sign is refused. Needs root's key; for deployer, targets'."""
    from tasks.deploy.trust.keyring import Role, checked_role, keyring
    from tasks.deploy.trust.repository import open_repository, rotate_key
    from tasks.storage.store_url import open_existing_store

    found = open_existing_store(store)
    wanted: list[Role] = [checked_role(name) for name in roles]  # all of them, before one is replaced
    for role in wanted:
        with open_repository(found, keyring(keys, found)) as session:
            rotate_key(session, role)
        echo(f"{role} has a new key")


@keys_app.command("renew")
def renew(keys: _Keys, store: _StoreUrl = None) -> None:
    """Sign the metadata anew before it expires; a deployment does so, too. Tells which keys are missing for that."""
    from tasks.deploy.trust.keyring import keyring
    from tasks.deploy.trust.repository import open_repository, renew_metadata
    from tasks.storage.store_url import open_existing_store

    found = open_existing_store(store)
    with open_repository(found, keyring(keys, found)) as session:
        due = renew_metadata(session)
        for role in due:
            echo(f"{role} expires at {session.state.expires(role):%Y-%m-%d}, and its key is not here", err=True)
    echo("renewed")


@keys_app.command("show")
def show(keys: _Keys, store: _StoreUrl = None) -> None:
    """Print each role's key, until when its metadata is accepted, and whether its private key is in the folder."""
    from tasks.deploy.trust.keyring import ROLES, keyring
    from tasks.deploy.trust.repository import open_repository
    from tasks.storage.store_url import open_existing_store

    found = open_existing_store(store)
    with open_repository(found, keyring(keys, found)) as session:
        for role in ROLES:
            (keyid,) = session.state.keyids(role)
            where = "here" if session.at_hand(role) else "not here"
            echo(f"{role:10}{keyid[:16]}  until {session.state.expires(role):%Y-%m-%d}  {where}")
