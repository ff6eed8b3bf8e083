"""`simyard report`. Thin; what it needs is imported when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer


def report(
    arn: Annotated[
        str,
        typer.Argument(metavar="ARN", help="A simulation job batch, one of its jobs, or a pipeline run."),
    ],
    *,
    show: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
    output: Annotated[
        Path | None, typer.Option(help="File to write. Default: report.html beside the tables.", show_default=False)
    ] = None,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Write the report of a batch, one HTML file that needs nothing but itself, and print where it is."""
    from flows.report_files import local_copy, write_to
    from tasks.storage.opening import open_existing_store

    place = write_to(open_existing_store(store), arn, output)
    typer.echo(place.url)
    if show:
        typer.launch(local_copy(place).as_uri())
