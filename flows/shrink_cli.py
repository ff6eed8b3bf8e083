"""`simyard shrink`. Thin; what it needs is imported when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer


def shrink(
    job: Annotated[str, typer.Argument(metavar="JOB_ARN", help="A simulation job that failed.", show_default=False)],
    *,
    output: Annotated[
        Path | None, typer.Option(help="Folder for the files. Default: shrunk-<batch>-<index>.", show_default=False)
    ] = None,
    budget: Annotated[int, typer.Option(min=2, max=100_000, help="How many episodes may be simulated.")] = 512,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Find the smallest world and the lowest seed in which a job still fails in the same way; write them as a case."""
    from flows.regression_case import write_case
    from flows.shrinking import shrunk
    from tasks.storage.opening import open_existing_store

    found = shrunk(open_existing_store(store), job, budget)
    before, after = found.world, found.small_world
    typer.echo(f"{found.job}: {found.reason}, in {found.episodes} episodes:")
    typer.echo(f"  furniture  {len(before.furniture)} -> {len(after.furniture)}" + _pieces(found.minimal))
    typer.echo(f"  seed       {found.request.seed} -> {found.small_request.seed}")
    typer.echo(f"  world      {found.request.world} -> {found.small_request.world}")
    for sentence in found.broken:
        typer.echo(f"  not guaranteed: {sentence}")
    for path in write_case(found, output or Path(f"shrunk-{found.job.replace('/', '-')}")):
        typer.echo(str(path))


def _pieces(minimal: bool) -> str:  # noqa: FBT001 - one flag, one word
    return " pieces, none of which can be left out" if minimal else " pieces; a larger --budget may leave fewer"
