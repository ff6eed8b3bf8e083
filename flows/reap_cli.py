"""`simyard reap`."""
# ruff: noqa: PLC0415 - what a command needs is imported when it runs

from typing import Annotated

import typer


def reap(
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Tell which jobs nobody works on; end those that were being stopped, and ready the others to be run on."""
    from flows.left_jobs import reap as reap_store
    from tasks.storage.opening import open_existing_store

    found = reap_store(open_existing_store(store))
    for each in found:
        change = each.status if each.status == each.was else f"{each.was} -> {each.status}"
        typer.echo(f"{each.arn}  {change}: {each.told}")
    if not found:
        typer.echo("somebody works on every job that is under way")
