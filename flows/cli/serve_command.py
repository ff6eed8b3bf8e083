"""The command `simyard serve`: RoboMaker's HTTP API from a store."""
# ruff: noqa: PLC0415 - imports when it runs, so that `--help` loads little

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.output import echo
from flows.cli.server_commands import PoolOption


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
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Answer RoboMaker's HTTP API from a store, for boto3, the AWS CLI and scripts, until Ctrl-C."""
    if model:
        _write_model(model)
    if model_only:
        return _require_folder(model)
    from flows.gateway.client_environment import gateway_url
    from flows.gateway.entrances import open_entrance, signed_entrance
    from flows.gateway.serve import Listener
    from flows.gateway.serve import serve as serve_store
    from flows.queue.crew import Crew
    from flows.queue.foreman import require_lasting_server
    from flows.queue.worker_log import log_to_stderr
    from flows.server.prefect_server import pages_url
    from tasks.gateway.access.key_file import access_file
    from tasks.gateway.connection.tls import tls_context
    from tasks.storage.store_url import open_store

    tls = tls_context(tls_certificate, tls_key)
    _check_reach(host, is_unsigned=unsigned, is_encrypted=tls is not None or without_tls)
    opened = open_store(store)
    if pool:
        require_lasting_server(pool)
    url = gateway_url(host, port, is_encrypted=tls is not None)
    if unsigned:
        entrance = open_entrance(opened, port, pages_url)
    else:
        keys = access_keys or access_file()
        _show_keys(keys, url, model)
        entrance = signed_entrance(opened, keys, pages_url, is_encrypted=tls is not None or without_tls)
    echo(f"RoboMaker: {url}  (store: {opened.url})")
    log_to_stderr()
    try:
        with Crew(opened.url, workers, pool) as crew:
            serve_store(opened, entrance, Listener(host, port, tls), crew.wake)
    except SystemExit:  # a signal is how it ends, after the answers to what had begun: nothing was interrupted
        echo("stopped", err=True)


def _show_keys(keys: Path, url: str, model: Path | None) -> None:
    """Makes the first key, if there is no file of keys, and says what its client needs."""
    from flows.gateway.client_environment import export_lines
    from tasks.gateway.access.key_file import first_key, read_keys

    made = first_key(keys)
    read_keys(keys)  # what is wrong with the file is said now, and not at each request
    if made is None:
        echo(f"# keys: {keys}  (simyard access list; simyard access export NAME)")
        return
    echo(f"# a first key with all rights is in {keys}; its client needs:")
    for line in export_lines(made, url, model):
        echo(line)


def _check_reach(host: str, *, is_unsigned: bool, is_encrypted: bool) -> None:
    from specs.base import Fault
    from specs.errors import DocumentError
    from tasks.gateway.access.page_origin import is_loopback

    if is_loopback(host):
        return
    if is_unsigned:
        allowed = "127.0.0.1 with --unsigned: whoever reaches another address would be let in"
        raise DocumentError([Fault(path="--host", value=repr(host), allowed=allowed)])
    if not is_encrypted:
        allowed = (
            "127.0.0.1 without TLS; name --tls-certificate and --tls-key, or say --without-tls if a proxy encrypts: "
            "anybody on the way could read answers, and the secrets of those who sign in to the page"
        )
        raise DocumentError([Fault(path="--host", value=repr(host), allowed=allowed)])


def _require_folder(model: Path | None) -> None:
    from specs.base import Fault
    from specs.errors import DocumentError

    if model is None:
        raise DocumentError([Fault(path="--model-only", value="alone", allowed="with --model ~/.aws/models")])


def _write_model(folder: Path) -> None:
    from tasks.gateway.sdk.service_model import write_model

    for path in write_model(folder.expanduser()):
        echo(f"wrote {path}")
