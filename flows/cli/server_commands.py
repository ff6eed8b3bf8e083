"""The commands `simyard up` and `down`, a Prefect server that stays; `serve` and `worker`; and `access`.

`simyard serve` answers RoboMaker's HTTP API from a store, `worker` works off a queue, `access` says who may call.
"""

import os
import shlex
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from flows.cli.terminal import StoreUrl, TerminalConsole, echo, echo_json, show_rows, waiting
from flows.gateway.serve import Listener, loopback_auth, signed_auth
from flows.gateway.serve import serve as serve_store
from flows.prefect.prefect_server import pages_url, prefect_home
from flows.queue.supervisor import QueueWorkers, lead, log_to_stderr, require_lasting_server, wait_for_ever
from specs.errors import DocumentError
from specs.settings import access_file
from tasks.gateway.access.access_keys import (
    add_key,
    export_lines,
    find_key,
    first_key,
    gateway_url,
    read_keys,
    revoke_key,
)
from tasks.gateway.access.action_log import actions
from tasks.gateway.access.guard import is_loopback
from tasks.gateway.connections import tls_context
from tasks.gateway.service_model import write_model
from tasks.server.health import password_file
from tasks.server.resident import end_kept, keep_server
from tasks.storage.base.proxies import exception_lines
from tasks.storage.store_url import open_existing_store, open_store

PoolOption = Annotated[
    str,
    typer.Option(
        "--pool",
        metavar="NAME",
        help="Hand each job to this work pool of the Prefect server that stays, instead of doing it here.",
        show_default=False,
    ),
]


def up() -> None:
    """Start a Prefect server that stays; `simyard run` uses it, and `eval "$(simyard up)"` lets `prefect` use it."""
    home = prefect_home()
    with waiting("a Prefect server starts; the first one makes its database"):
        server = keep_server(home)
    password = shlex.quote(str(password_file(home)))
    if server.notice:
        echo(server.notice, err=True)
    # A shell takes all of it: eval "$(simyard up)"
    echo(f"# Prefect: {server.api_url.removesuffix('/api')}  (log: {server.log})")
    echo(f"# its pages ask for the password in {password}")
    echo(f"export PREFECT_API_URL={server.api_url}")
    echo(f'export PREFECT_API_AUTH_STRING="$(cat {password})"')
    for line in exception_lines(server.api_url, os.environ):
        echo(line)


def down() -> None:
    """End the server that `simyard up` started."""
    server = end_kept(prefect_home())
    echo(f"ended {server.api_url}" if server else "no server was running")


def worker(
    *,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=1, help="So many batches, and so many jobs of worlds, at once.")
    ] = 1,
    pool: PoolOption = "",
    store: StoreUrl = None,
) -> None:
    """Work off the jobs that calls of RoboMaker's API have put into a store's queue, until Ctrl-C.

    `simyard serve` has a worker of its own; this is one more, on any machine that reaches the store.
    """
    opened = open_store(store)
    log_to_stderr()
    lead(opened.url, workers, pool, wait_for_ever)


def serve(
    *,
    port: Annotated[int, typer.Option("--port", metavar="N", min=1, max=65535, help="Where requests come in.")] = 8600,
    host: Annotated[str, typer.Option("--host", metavar="H", help="The address that it listens on.")] = "127.0.0.1",
    unsigned: Annotated[
        bool, typer.Option("--unsigned", help="Let in every program of this machine; on 127.0.0.1 only.")
    ] = False,
    access_keys: Annotated[
        Path | None,
        typer.Option(
            "--access-keys",
            metavar="FILE",
            envvar="SIMYARD_ACCESS_FILE",
            help="The keys of clients; made with a first one if it is missing. Default: ~/.config/simyard/access-keys.",
            show_default=False,
        ),
    ] = None,
    tls_certificate: Annotated[
        Path | None,
        typer.Option("--tls-certificate", metavar="PEM", help="Answer by HTTPS: the certificate.", show_default=False),
    ] = None,
    tls_key: Annotated[
        Path | None, typer.Option("--tls-key", metavar="PEM", help="The certificate's key.", show_default=False)
    ] = None,
    without_tls: Annotated[
        bool, typer.Option("--without-tls", help="Listen beyond this machine without TLS: a proxy in front encrypts.")
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="FOLDER",
            help="First write RoboMaker's model for SDKs there; they find it in ~/.aws/models.",
            show_default=False,
        ),
    ] = None,
    model_only: Annotated[
        bool, typer.Option("--model-only", help="Write the model and end; needs no store and no key.")
    ] = False,
    workers: Annotated[
        int,
        typer.Option(
            "--workers", metavar="N", min=0, help="So many batches at once, each in a process; 0 leaves jobs to others."
        ),
    ] = 1,
    pool: PoolOption = "",
    store: StoreUrl = None,
) -> None:
    """Answer RoboMaker's HTTP API from a store, for boto3, the AWS CLI and scripts, until Ctrl-C."""
    if model:
        for path in write_model(model.expanduser()):
            echo(f"wrote {path}")
    if model_only:
        return _require_folder(model)

    tls = tls_context(tls_certificate, tls_key)
    _check_reach(host, is_unsigned=unsigned, is_encrypted=tls is not None or without_tls)
    opened = open_store(store)
    if pool:
        require_lasting_server(pool)
    url = gateway_url(host, port, is_encrypted=tls is not None)
    if unsigned:
        auth = loopback_auth(opened, port, pages_url)
    else:
        keys = access_keys or access_file()
        _show_keys(keys, url, model)
        auth = signed_auth(opened, keys, pages_url, is_encrypted=tls is not None or without_tls)
    echo(f"RoboMaker: {url}  (store: {opened.url})")
    log_to_stderr()
    try:
        with QueueWorkers(opened.url, workers, pool) as queue_workers:
            serve_store(opened, auth, Listener(host, port, tls), queue_workers.wake)
    except SystemExit:  # a signal is how it ends, after the answers to what had begun: nothing was interrupted
        echo("stopped", err=True)


def _show_keys(keys: Path, url: str, model: Path | None) -> None:
    """Makes the first key, if there is no file of keys, and tells a person at a terminal what its client needs."""
    made = first_key(keys)
    read_keys(keys)  # what is wrong with the file is said now, and not at each request
    if made is None:
        echo(f"# keys: {keys}  (simyard access list; simyard access export NAME)")
        return
    if not sys.stdout.isatty():  # a journal or a file, which keeps what is printed
        echo(f"# a first key with all rights is in {keys}; for what its client needs, with the secret:")
        file = "" if keys == access_file() else f" --access-keys {shlex.quote(str(keys))}"
        echo(f"# simyard access export {made.name} --url {url}{file}")
        return
    echo(f"# a first key with all rights is in {keys}; its client needs:")
    for line in export_lines(made, url, model):
        echo(line)


def _check_reach(host: str, *, is_unsigned: bool, is_encrypted: bool) -> None:
    if is_loopback(host):
        return
    if is_unsigned:
        allowed = "127.0.0.1 with --unsigned: whoever reaches another address would be let in"
        raise DocumentError.of("--host", repr(host), allowed)
    if not is_encrypted:
        allowed = (
            "127.0.0.1 without TLS; name --tls-certificate and --tls-key, or say --without-tls if a proxy encrypts: "
            "anybody on the way could read answers, and the secrets of those who sign in to the page"
        )
        raise DocumentError.of("--host", repr(host), allowed)


def _require_folder(model: Path | None) -> None:
    if model is None:
        raise DocumentError.of("--model-only", "alone", "with --model ~/.aws/models")


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
def make_key(
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
    for line in export_lines(add_key(file or access_file(), name, rights, on or ()), url):
        echo(line)


@access_app.command("list")
def list_keys(file: _File = None) -> None:
    """Show the keys, their rights and limits, and no secret."""
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
    show_rows(rows, TerminalConsole())


@access_app.command("export")
def export_key(name: _Name, url: _Url = "http://127.0.0.1:8600", file: _File = None) -> None:
    """Print what the client of a key needs, the secret included, as lines for a shell."""
    path = file or access_file()
    for line in export_lines(find_key(read_keys(path), name, path), url):
        echo(line)


@access_app.command("revoke")
def withdraw_key(name: _Name, file: _File = None) -> None:
    """Remove a key: a gateway that runs refuses it from its next request on."""
    key = revoke_key(file or access_file(), name)
    echo(f"revoked {key.name} ({key.key_id})")


@access_app.command("log")
def show_log(
    days: Annotated[int, typer.Option("--days", min=1, max=3650, help="Of how many days, today's among them.")] = 1,
    store: StoreUrl = None,
) -> None:
    """Print who changed what over HTTP, and who was refused, of all gateways of the store: a line of JSON each."""
    for line in actions(open_existing_store(store), days, time.time()):
        echo_json(line)
