"""`simyard replay`. Thin; what it needs is imported when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console


def replay(
    job: Annotated[str, typer.Argument(metavar="JOB_ARN", help="A simulation job.", show_default=False)],
    *,
    output: Annotated[
        Path | None, typer.Option(help="Folder for the files. Default: replay-<batch>-<index>.", show_default=False)
    ] = None,
    mcap: Annotated[
        bool | None,
        typer.Option(
            "--mcap/--no-mcap", help="Write replay.mcap for Foxglove. Default: where simyard\\[mcap] is there."
        ),
    ] = None,
    video: Annotated[bool, typer.Option("--video", help="Write replay.mp4; needs simyard\\[video].")] = False,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Simulate an episode once more, compare it bit for bit with its record, and draw it; 1 if it deviates."""
    from flows.replay_files import wanted_files, write_files
    from flows.replay_printing import show_replay
    from flows.replaying import replayed
    from tasks.storage.opening import open_existing_store

    wanted = wanted_files(mcap=mcap, video=video)
    again = replayed(open_existing_store(store), job)
    show_replay(again, Console())
    folder = output or Path(f"replay-{again.job.replace('/', '-')}")
    for path in write_files(again, folder, wanted):
        typer.echo(str(path))
    if not again.same:
        raise typer.Exit(1)
