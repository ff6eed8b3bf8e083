"""The commands `simyard replay`, `compare`, `shrink` and `report`. Each imports what it needs when it runs."""
# ruff: noqa: PLC0415 - see above

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.exit_codes import NOT_PASSED, UNDECIDED
from flows.cli.output import TerminalConsole, echo, echo_json


def replay(
    job: Annotated[
        str, typer.Argument(metavar="JOB", help="A simulation job: its ARN, or <batch>/<index>.", show_default=False)
    ],
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
    bag: Annotated[
        list[str] | None,
        typer.Option(
            metavar="rosbag|mcap-ros1|rosbag2",
            help="Write a bag for ROS's tools; may be given several times; needs simyard\\[ros].",
            show_default=False,
        ),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Simulate an episode once more, compare it bit for bit with its record, and draw it; 1 if it deviates."""
    from flows.batch.replay_episode import replay_job
    from flows.batch.replay_files import wanted_files, write_files
    from flows.cli.batch.batch_text import show_replay
    from tasks.storage.store_url import open_existing_store

    wanted = wanted_files(mcap=mcap, video=video, bags=bag or ())
    again = replay_job(open_existing_store(store), job)
    show_replay(again, TerminalConsole())
    folder = output or Path(f"replay-{again.job.replace('/', '-')}")
    for path in write_files(again, folder, wanted):
        echo(str(path))
    if not again.same:
        raise typer.Exit(NOT_PASSED)


_Batch = Annotated[
    str,
    typer.Argument(
        help="A simulation job batch, one of its jobs, or a pipeline run: its ARN or id. BATCH@VERSION picks one of "
        "several versions.",
        show_default=False,
    ),
]


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
    markdown: Annotated[bool, typer.Option("--markdown", help="Print a comment for a pull request.")] = False,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Compare two batches over the episodes that both have; 0: B is no worse than A; 1: worse; 4: not shown."""
    from flows.batch.compare_batches import common_episodes, find_batch, flip_maps
    from flows.cli.batch.batch_text import comparison_comment, show_comparison
    from tasks.results.compare.comparison_verdict import comparison
    from tasks.simulate.batch.provenance import unvouched_notice
    from tasks.storage.store_url import open_existing_store

    if as_json and markdown:
        raise typer.BadParameter("one of --json and --markdown; a comment is no JSON document")
    quiet, opened = as_json or markdown, open_existing_store(store)
    first, second = find_batch(opened, batch_a), find_batch(opened, batch_b)
    pairs = common_episodes(first, second)
    found = comparison(first.name, second.name, pairs, margin=margin, confidence=confidence)
    if as_json:
        echo_json(found.model_dump_json(indent=2))
    elif markdown:
        echo(comparison_comment(first, second, found).rstrip())
    else:
        show_comparison(found, TerminalConsole())
    for notice in filter(None, map(unvouched_notice, (first.work, second.work))):
        echo(notice, err=True)
    if output is not None and not pairs.flips:
        echo(f"nothing was written to {output}: no episode came out differently", err=quiet)
    elif output is not None:
        output.mkdir(parents=True, exist_ok=True)
        for each in flip_maps(first, second, pairs.flips):
            path = output / f"flips-{each.world.replace('/', '-')}.svg"
            path.write_text(each.svg, encoding="utf-8")
            echo(str(path), err=quiet)
    if found.answer != "NO WORSE":
        raise typer.Exit(UNDECIDED if found.answer == "INCONCLUSIVE" else NOT_PASSED)


def shrink(
    job: Annotated[
        str,
        typer.Argument(
            metavar="JOB", help="A simulation job that failed: its ARN, or <batch>/<index>.", show_default=False
        ),
    ],
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
    from flows.batch.regression_case import write_case
    from flows.batch.shrink import shrink_job
    from tasks.storage.store_url import open_existing_store

    found = shrink_job(open_existing_store(store), job, budget)
    before, after = found.world, found.small_world
    echo(f"{found.job}: {found.reason}, in {found.episodes} episodes:")
    echo(f"  failure    {found.likeness}")
    echo(f"  furniture  {len(before.furniture)} -> {len(after.furniture)}" + _pieces(found.minimal))
    echo(f"  seed       {found.request.seed} -> {found.small_request.seed}")
    echo(f"  world      {found.request.world} -> {found.small_request.world}")
    for sentence in found.broken:
        echo(f"  not guaranteed: {sentence}")
    for path in write_case(found, output or Path(f"shrunk-{found.job.replace('/', '-')}")):
        echo(str(path))


def _pieces(minimal: bool) -> str:  # noqa: FBT001 - one flag, one word
    return " pieces, no single one of which can go" if minimal else " pieces; a larger --budget may leave fewer"


def report(
    arn: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="A simulation job batch, one of its jobs, or a pipeline run: its ARN or id."
        ),
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
    from flows.batch.report_files import local_copy, write_report_page
    from tasks.storage.store_url import open_existing_store

    place = write_report_page(open_existing_store(store), arn, output)
    echo(place.url)
    if place.notice:
        echo(place.notice, err=True)
    if show:
        typer.launch(local_copy(place).as_uri())
