"""The command `simyard serve`: RoboMaker's HTTP API from a store."""
# ruff: noqa: PLC0415 - imports when it runs, so that `--help` loads little

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.output import echo

_LOOPBACK = ("127.0.0.1", "::1", "localhost")


def serve(
    *,
    port: Annotated[int, typer.Option("--port", metavar="N", min=1, max=65535, help="Where requests come in.")] = 8600,
    host: Annotated[str, typer.Option("--host", metavar="H", help="The address that it listens on.")] = "127.0.0.1",
    unsigned: Annotated[
        bool, typer.Option("--unsigned", help="Let in every program of this machine; on 127.0.0.1 only.")
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
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Answer RoboMaker's HTTP API from a store, for boto3, the AWS CLI and scripts, until Ctrl-C."""
    if model:
        _write_model(model)
    if model_only:
        return
    from flows.gateway.serve import Listener
    from flows.gateway.serve import serve as serve_store
    from specs.base import Fault
    from specs.errors import DocumentError
    from tasks.gateway.door import LoopbackGuard
    from tasks.storage.store_url import open_store

    if not unsigned:
        raise DocumentError([Fault(path="--unsigned", value="left out", allowed="signatures are not checked yet")])
    if host not in _LOOPBACK:
        raise DocumentError([Fault(path="--host", value=repr(host), allowed="with --unsigned, 127.0.0.1")])
    opened = open_store(store)
    shown = f"[{host}]" if ":" in host else host
    echo(f"RoboMaker: http://{shown}:{port}  (store: {opened.url})")
    serve_store(opened, LoopbackGuard(), Listener(host, port))


def _write_model(folder: Path) -> None:
    from tasks.gateway.sdk.service_model import write_model

    for path in write_model(folder.expanduser()):
        echo(f"wrote {path}")
