"""The commands of `simyard fleet keys`, and `simyard fleet vouch`. Each imports what it needs when it runs."""
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
def renew(
    keys: _Keys,
    store: _StoreUrl = None,
    hours: Annotated[
        int | None,
        typer.Option(
            "--timestamp-hours",
            min=1,
            max=8760,
            help="From now on, sign timestamps for so long: as long may something withdrawn be accepted. At first 24.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Sign the metadata anew before it expires; a deployment does so, too. Tells which keys are missing for that."""
    from tasks.deploy.trust.keyring import keyring
    from tasks.deploy.trust.repository import open_repository, renew_metadata
    from tasks.storage.store_url import open_existing_store

    found = open_existing_store(store)
    with open_repository(found, keyring(keys, found)) as session:
        if hours:
            session.choose_lifetime(hours)
        due = renew_metadata(session)
        for role in due:
            echo(f"{role} expires at {session.state.expires(role):%Y-%m-%d}, and its key is not here", err=True)
    echo("renewed")


@keys_app.command("restore")
def restore(keys: _Keys, store: _StoreUrl = None) -> None:
    """Write back the metadata that these keys signed last, where the store has lost it or shows older metadata."""
    from tasks.deploy.trust.kept_metadata import restore_metadata
    from tasks.deploy.trust.keyring import keyring
    from tasks.storage.store_url import open_existing_store

    found = open_existing_store(store)
    echo(f"version {restore_metadata(found, keyring(keys, found))} is in {found.url} again")


@keys_app.command("show")
def show(keys: _Keys, store: _StoreUrl = None) -> None:
    """Print each role's key, until when its metadata is accepted, and whether it is here; and what is in force."""
    from flows.resource.withdrawal import force_lines
    from tasks.deploy.trust.keyring import ROLES, keyring
    from tasks.deploy.trust.repository import open_repository
    from tasks.deploy.trust.vouched_fleets import VouchedFleets, read_fleets
    from tasks.storage.store_url import open_existing_store

    found = open_existing_store(store)
    with open_repository(found, keyring(keys, found)) as session:
        for role in ROLES:
            (keyid,) = session.state.keyids(role)
            where = "here" if session.at_hand(role) else "not here"
            until = session.state.expires(role).strftime("%Y-%m-%dT%H:%MZ" if role == "timestamp" else "%Y-%m-%d")
            echo(f"{role:10}{keyid[:16]}  until {until:17}  {where}")
        fleets = read_fleets(session.state.deployer.signed) or VouchedFleets()
    for line in force_lines(fleets):
        echo(line)


def vouch(
    fleet: Annotated[str, typer.Argument(metavar="FLEET", help="The fleet's name or ARN.", show_default=False)],
    keys: _Keys,
    robots: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ROBOT]...", help="Robots of the fleet; all of them, if none is named."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,  # noqa: FBT002 - a switch
    store: _StoreUrl = None,
) -> None:
    """Sign that robots belong to a fleet, as the store's records say; robots that left it are signed out of it."""
    from flows.resource.roster import roster_change
    from tasks.deploy.trust.signer import open_signer
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    change = roster_change(opened, open_signer(opened, keys), fleet, robots or ())
    for line in change.lines:
        echo(line)
    if change.lines and not (yes or robots):
        typer.confirm("Is that the fleet?", abort=True)
    change.sign()
    echo(f"{change.members} robots of {change.fleet} are vouched for")
