"""`simyard compare`. Thin; what it needs is imported when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

_Batch = Annotated[str, typer.Argument(help="A simulation job batch: its ARN or id.", show_default=False)]


def compare(
    batch_a: _Batch,
    batch_b: _Batch,
    *,
    margin: Annotated[float, typer.Option(min=0.0, max=1.0, help="How much lower B's success rate may be.")] = 0.02,
    confidence: Annotated[float, typer.Option(min=0.5, max=0.9999, help="Of the intervals.")] = 0.95,
    output: Annotated[
        Path | None,
        typer.Option(help="Folder for a map of each world with flips; none by default.", show_default=False),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Compare two batches over the episodes that both have; 0 if B is shown to be no worse than A, else 1."""
    from flows.compare_printing import show_comparison
    from flows.comparing import batch_named, flip_maps, pairs_of
    from tasks.results.comparing_verdict import comparison
    from tasks.storage.opening import open_existing_store

    opened = open_existing_store(store)
    first, second = batch_named(opened, batch_a), batch_named(opened, batch_b)
    pairs = pairs_of(first, second)
    found = comparison(first.work.id, second.work.id, pairs, margin=margin, confidence=confidence)
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
    else:
        show_comparison(found, Console())
    if output is not None and not pairs.flips:
        typer.echo(f"nothing was written to {output}: no episode came out differently", err=as_json)
    elif output is not None:
        output.mkdir(parents=True, exist_ok=True)
        for each in flip_maps(first, second, pairs.flips):
            path = output / f"flips-{each.world.replace('/', '-')}.svg"
            path.write_text(each.svg, encoding="utf-8")
            typer.echo(str(path), err=as_json)
    if found.answer != "NO WORSE":
        raise typer.Exit(1)
