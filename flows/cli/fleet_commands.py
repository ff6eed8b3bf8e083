"""The commands of `simyard fleet`, `keys` and `agent-kit` among them. Each imports what it needs when it runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal
from uuid import uuid4

import typer
from pydantic import JsonValue

from flows.cli.fleet_watch import fleet_notes, next_deployment, watch_deployment
from flows.cli.terminal import StoreUrl, TerminalConsole, echo, echo_json
from flows.resources.fleet_membership import force_lines, membership_change
from specs.errors import DocumentError
from specs.robomaker.deployment import SyncDeploymentJobRequest
from specs.untrusted_text import terminal_line
from tasks.deploy.fleet.fleet_registry import (
    create_fleet,
    create_robot,
    deregister_robot,
    fleet_name,
    members,
    read_fleet,
    read_robot,
    register_robot,
)
from tasks.deploy.fleet.reservation import delete_fleet
from tasks.deploy.fleet.reservation import delete_robot as delete_named
from tasks.deploy.fleet_descriptions import describe_fleet, describe_robot
from tasks.deploy.kit.robot_kit import write_kit
from tasks.deploy.rollout.deployment_job import run_sync_job
from tasks.deploy.rollout.observation import recorded_progress, rollout_standing
from tasks.deploy.rollout.operator_commands import active_deployment, steer
from tasks.deploy.rollout.resolved_request import latest_deployment, plan_sync, robots_without_build, sync_request
from tasks.deploy.trust.keyring import ROLES, ROOT_FILE, Role, checked_role, keyring
from tasks.deploy.trust.repository import init_keys, open_repository, renew_metadata, restore_metadata, rotate_key
from tasks.deploy.trust.signed_fleets import SignedFleets, read_fleets
from tasks.deploy.trust.signer import DeploymentSigner, chosen_signer, open_signer
from tasks.deploy.trust.trust_record import is_unsigned
from tasks.documents.parse import parse
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_existing_store, open_store

keys_app = typer.Typer(help="Make, renew and replace the keys that vouch for deployments.", no_args_is_help=True)

_RequiredKeys = Annotated[
    Path,
    typer.Option(
        "--keys", envvar="SIMYARD_KEYS", help="The folder with the private keys, outside the store.", show_default=False
    ),
]


@keys_app.command("init")
def init(keys: _RequiredKeys, store: StoreUrl = None) -> None:
    """Make the keys in the folder, and their metadata in the store; what is there stays. Prints the root of trust."""
    ring = init_keys(open_store(store), keys)
    echo(f"{ring.folder / ROOT_FILE}: give it to each robot: simyard agent --root-of-trust {ROOT_FILE}")
    echo("root-*.pem and targets-*.pem are only needed to replace a key: keep them offline")


@keys_app.command("rotate")
def rotate(
    roles: Annotated[
        list[str],
        typer.Argument(metavar="ROLE...", help="root, targets, deployer, snapshot, timestamp.", show_default=False),
    ],
    keys: _RequiredKeys,
    store: StoreUrl = None,
) -> None:
    """Replace keys, as after a theft: what the old ones sign is refused. Needs root's key; for deployer, targets'."""
    found = open_existing_store(store)
    wanted: list[Role] = [checked_role(name) for name in roles]  # all of them, before one is replaced
    for role in wanted:
        with open_repository(found, keyring(keys, found)) as session:
            rotate_key(session, role)
        echo(f"{role} has a new key")


@keys_app.command("renew")
def renew(
    keys: _RequiredKeys,
    store: StoreUrl = None,
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
    found = open_existing_store(store)
    with open_repository(found, keyring(keys, found)) as session:
        if hours:
            session.choose_lifetime(hours)
        due = renew_metadata(session)
        for role in due:
            echo(f"{role} expires at {session.state.expires(role):%Y-%m-%d}, and its key is not here", err=True)
    echo("renewed")


@keys_app.command("restore")
def restore(keys: _RequiredKeys, store: StoreUrl = None) -> None:
    """Write back the metadata that these keys signed last, where the store has lost it or shows older metadata."""
    found = open_existing_store(store)
    echo(f"version {restore_metadata(found, keyring(keys, found))} is in {found.url} again")


@keys_app.command("show")
def show_keys(keys: _RequiredKeys, store: StoreUrl = None) -> None:
    """Print each role's key, until when its metadata is accepted, and whether it is here; and what is in force."""
    found = open_existing_store(store)
    with open_repository(found, keyring(keys, found)) as session:
        for role in ROLES:
            (keyid,) = session.state.keyids(role)
            where = "here" if session.at_hand(role) else "not here"
            until = session.state.expires(role).strftime("%Y-%m-%dT%H:%MZ" if role == "timestamp" else "%Y-%m-%d")
            echo(f"{role:10}{keyid[:16]}  until {until:17}  {where}")
        fleets = read_fleets(session.state.deployer.signed)
    for line in force_lines(fleets):
        echo(line)


def sign_members(
    fleet: Annotated[str, typer.Argument(metavar="FLEET", help="The fleet's name or ARN.", show_default=False)],
    keys: _RequiredKeys,
    robots: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ROBOT]...", help="Robots of the fleet; all of them, if none is named."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,  # noqa: FBT002 - a switch
    store: StoreUrl = None,
) -> None:
    """Sign that robots belong to a fleet, as the store's records say; robots that left it are signed out of it."""
    opened = open_existing_store(store)
    change = membership_change(opened, open_signer(opened, keys), fleet, robots or ())
    for line in change.lines:
        echo(line)
    if change.lines and not (yes or robots):
        typer.confirm("Is that the fleet?", abort=True)
    change.sign()
    echo(f"{change.members} robots of {change.fleet} are vouched for")


def agent_kit(
    folder: Annotated[Path, typer.Argument(help="Where to; made if it is missing.", show_default=False)],
    keys: Annotated[
        Path | None,
        typer.Option(
            "--keys", envvar="SIMYARD_KEYS", help="The folder of simyard fleet keys init.", show_default=False
        ),
    ] = None,
    store: StoreUrl = None,
    unsigned: Annotated[bool, typer.Option("--unsigned", help="For robots that verify nothing.")] = False,  # noqa: FBT002 - a switch
) -> None:
    """Write what a robot needs: the agent, an installer, a systemd unit, the store's URL and the root of trust."""
    root = None if unsigned or keys is None else keys / ROOT_FILE
    if not unsigned and (root is None or not root.is_file()):
        allowed = "the folder of simyard fleet keys init; or --unsigned, for robots that run whatever is in the store"
        raise DocumentError.of("--keys", str(keys or ""), allowed)
    opened = open_existing_store(store)
    for path in write_kit(folder, store_url=opened.url, root_of_trust=root.read_bytes() if root else None):
        echo(path)
    echo(f"on each robot, from a copy of {folder}: sudo ./install.sh NAME")


fleet_app = typer.Typer(help="Make fleets and put robots into them.", no_args_is_help=True)
fleet_app.add_typer(keys_app, name="keys")
fleet_app.command("agent-kit")(agent_kit)
fleet_app.command("vouch")(sign_members)

_Fleet = Annotated[str, typer.Argument(metavar="FLEET", help="The fleet's name or ARN.", show_default=False)]
_Keys = Annotated[
    Path | None,
    typer.Option(
        "--keys",
        envvar="SIMYARD_KEYS",
        help="The folder of simyard fleet keys init; it signs this.",
        show_default=False,
    ),
]


@fleet_app.command("create")
def create(
    name: Annotated[str, typer.Argument(help="The fleet's name.", show_default=False)], store: StoreUrl = None
) -> None:
    """Make a fleet; one that is there stays as it is."""
    opened = open_store(store)
    echo(describe_fleet(opened, create_fleet(opened, name).name).arn)


@fleet_app.command("register")
def register(
    fleet: _Fleet,
    robot: Annotated[str, typer.Argument(help="The robot's name; made if there is none.", show_default=False)],
    architecture: Annotated[
        Literal["X86_64", "ARM64", "ARMHF"] | None, typer.Option(help="Of its processor; X86_64 for a new robot.")
    ] = None,
    keys: _Keys = None,
    store: StoreUrl = None,
) -> None:
    """Put a robot into a fleet; a robot has one. Prints the robot's ARN. With keys, they vouch for it."""
    opened = open_store(store)
    found = read_fleet(opened, fleet)  # before there is a robot that belongs nowhere
    known = create_robot(opened, robot, architecture or "X86_64")
    if architecture not in {None, known.architecture}:
        value, allowed = f"{robot}, of architecture {known.architecture}", f"a robot of architecture {architecture}"
        raise DocumentError.of("--architecture", value, f"{allowed}; delete it to make it anew")
    register_robot(opened, found.name, robot)
    echo(describe_robot(opened, robot).arn)
    later = f"no key vouches for it yet (--keys): simyard fleet vouch {found.name} {known.name}"
    _sign(opened, keys, lambda fleets: fleets.enlisted(found.name, [known.name]), later)


@fleet_app.command("show")
def show(fleet: _Fleet, store: StoreUrl = None) -> None:
    """Print a fleet, its robots and its last deployment, as JSON; on stderr, what each robot runs."""
    opened = open_store(store)
    echo_json(describe_fleet(opened, fleet).model_dump_json(indent=2, exclude_none=True))
    for line in fleet_notes(opened, fleet):  # what RoboMaker's shapes have no fields for
        echo(line, err=True)


@fleet_app.command("sync")
def sync(
    fleet: _Fleet,
    store: StoreUrl = None,
    unsigned: Annotated[bool, typer.Option("--unsigned", help="Ask robots that verify nothing.")] = False,  # noqa: FBT002 - a switch
    failed: Annotated[bool, typer.Option("--failed", help="Only robots that failed, or did not answer.")] = False,  # noqa: FBT002 - a switch
    token: Annotated[
        str | None, typer.Option(help="Client request token: the same one again is the same deployment.")
    ] = None,
) -> None:
    """Bring a fleet to its latest deployment: robots that joined later, were away, or failed; signed (SIMYARD_KEYS)."""
    opened = open_existing_store(store)
    last = latest_deployment(opened, fleet)
    plan = plan_sync(opened, last, only_failed=failed)
    asked: dict[str, JsonValue] = {"clientRequestToken": token or uuid4().hex, "fleet": sync_request(last, "-").fleet}
    request = parse(SyncDeploymentJobRequest, asked, "simyard")
    never, behind = robots_without_build(members(opened, plan.fleet), plan), [*plan.environments]
    # Who asks no robot need not say that it is asked unsigned, where that was said before.
    unsigned = unsigned or (not behind and is_unsigned(last))
    signer = chosen_signer(opened, "unsigned" if unsigned else "signed", local=False)
    if never:
        echo(f"left out, the version has no bundle for their architecture: {', '.join(never)}")
    echo(_sync_line(fleet, behind, failed=failed, others=bool(never)))
    record = run_sync_job(
        opened,
        fleet,
        token=request.clientRequestToken,
        progress=lambda in_sync, robots: echo(f"{in_sync} of {robots} robots run it"),
        only_failed=failed,
        signer=signer,
    )
    said = "; ".join(filter(None, rollout_standing(record, recorded_progress(record))))
    echo(f"{record.status} {record.arn}: {terminal_line(said)}")
    raise typer.Exit(0 if record.status == "Succeeded" else 1)


def _sync_line(fleet: str, behind: list[str], *, failed: bool, others: bool) -> str:
    """Returns what a sync is about to do; with nobody to ask, its deployment is Succeeded at once."""
    if behind:
        return f"waiting for the agents of {', '.join(behind)}; simyard fleet watch {fleet} shows them"
    return f"no robot of {fleet} failed" if failed else f"all {'other ' if others else ''}robots of {fleet} are in sync"


@fleet_app.command("pause")
def pause(fleet: _Fleet, store: StoreUrl = None) -> None:
    """Let the deployment that is under way ask no further robot; those that were asked finish."""
    _steer(fleet, store, "pause")


@fleet_app.command("resume")
def resume(fleet: _Fleet, store: StoreUrl = None) -> None:
    """Let a paused deployment go on."""
    _steer(fleet, store, "go")


@fleet_app.command("watch")
def watch(
    fleet: _Fleet,
    store: StoreUrl = None,
    wait: Annotated[bool, typer.Option("--wait", help="If none is under way, wait for the next one.")] = False,  # noqa: FBT002 - a switch
) -> None:
    """Show a fleet's last deployment, robot by robot, until it ends; exits with 1 unless it succeeded."""
    opened = open_existing_store(store)
    deployment = next_deployment(opened, fleet) if wait else read_fleet(opened, fleet).deployment
    if not deployment:
        echo(f"nothing was deployed to {fleet} yet")
        return
    job = watch_deployment(opened, deployment, TerminalConsole())
    raise typer.Exit(0 if job.status == "Succeeded" else 1)


def _steer(fleet: str, store: str | None, wish: Literal["go", "pause"]) -> None:
    opened = open_existing_store(store)
    if not (job := active_deployment(opened, fleet)):
        echo(f"no deployment of {fleet} is under way", err=True)
        raise typer.Exit(2)
    record = steer(opened, job, wish)
    echo(f"{'paused' if wish == 'pause' else 'going on'}: {record.arn}")


@fleet_app.command("deregister")
def deregister(
    robot: Annotated[str, typer.Argument(help="The robot's name or ARN.", show_default=False)],
    keys: _Keys = None,
    store: StoreUrl = None,
) -> None:
    """Take a robot out of its fleet; what it runs, it keeps running. With keys, they sign it out."""
    opened = open_existing_store(store)
    name = deregister_robot(opened, read_robot(opened, robot).name).name
    _sign(opened, keys, lambda fleets: fleets.dismissed({name}))
    echo(f"{name} is in no fleet now")


@fleet_app.command("delete")
def delete(fleet: _Fleet, keys: _Keys = None, store: StoreUrl = None) -> None:
    """Delete a fleet; its robots are in no fleet then. With keys, what was deployed to it is withdrawn."""
    opened = open_existing_store(store)
    left = delete_fleet(opened, fleet)
    _sign(opened, keys, lambda fleets: fleets.dissolved(fleet_name(fleet)))
    echo(f"{fleet} is deleted" + (f"; in no fleet now: {', '.join(left)}" if left else ""))


@fleet_app.command("delete-robot")
def delete_robot(
    robot: Annotated[str, typer.Argument(help="The robot's name or ARN.", show_default=False)],
    keys: _Keys = None,
    store: StoreUrl = None,
) -> None:
    """Forget a robot, also in the middle of a deployment. With keys, they sign it out of its fleet."""
    opened = open_existing_store(store)
    name = delete_named(opened, robot)
    _sign(opened, keys, lambda fleets: fleets.dismissed({name}))
    echo(f"{name} is deleted")


def _signer(store: "Store", keys: Path | None) -> "DeploymentSigner":
    if keys is None:
        allowed = "the folder of simyard fleet keys init (--keys, or SIMYARD_KEYS)"
        raise DocumentError.of("--keys", "", allowed)
    return open_signer(store, keys)


def _sign(
    store: "Store",
    keys: Path | None,
    change: "Callable[[SignedFleets], SignedFleets]",
    later: str = "the keys still vouch for what it was; type it again with them (--keys)",
) -> None:
    """Signs the change, if there are keys; else says what is to be done later, where anything is signed at all."""
    if keys:
        _signer(store, keys).sign_fleets(change)
    elif next(iter(store.keys("trust")), None):
        echo(later, err=True)
