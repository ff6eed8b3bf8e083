"""The commands `simyard replay`, `compare`, `shrink` and `suite`, and what they print.

They simulate episodes once more, and import what that needs.
"""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from flows.batch.compare_batches import ComparedBatch, common_episodes, find_batch, flip_maps
from flows.batch.replay_episode import JobReplay, replay_job, wanted_files, write_files
from flows.batch.search_batch import replay_found
from flows.batch.shrink import shrink_job, write_case
from flows.batch.suite import regression_suite
from flows.cli.ci_report import store_option
from flows.cli.terminal import NOT_PASSED, UNDECIDED, StoreUrl, TerminalConsole, echo, echo_json, waiting
from specs.data.result_columns import REQUESTED
from tasks.results.batch_comparison import (
    Comparison,
    comparison,
    comparison_answer,
    comparison_notes,
    comparison_warning,
    flip_text,
)
from tasks.results.ci.github import comparison_markdown
from tasks.results.playback.playback import ColumnDeviation
from tasks.results.statistics.intervals import wilson
from tasks.simulate.batch.provenance import unvouched_notice
from tasks.storage.store_url import open_existing_store

FLIPS_SHOWN = 40
# What it was asked for says nothing of what came of it.
_ASKED = frozenset(field.name for field in REQUESTED)
_UNKNOWN = "nothing that the record names has changed: please report this, with the batch's record"
_STYLES = {"NO WORSE": "bold green", "WORSE": "bold red", "INCONCLUSIVE": "bold yellow"}


def replay(
    job: Annotated[
        str, typer.Argument(metavar="JOB", help="A simulation job: its ARN, or <batch>/<index>.", show_default=False)
    ],
    *,
    found: Annotated[
        int | None,
        typer.Option(min=1, help="Of a batch: which failure that its document's search has found.", show_default=False),
    ] = None,
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
    store: StoreUrl = None,
) -> None:
    """Simulate an episode once more, compare it bit for bit with its record, and draw it; 1 if it deviates."""
    wanted = wanted_files(mcap=mcap, video=video, bags=bag or ())
    with waiting("the episode is simulated once more"):
        opened = open_existing_store(store)
        again = replay_job(opened, job) if found is None else replay_found(opened, job, found)
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
    store: StoreUrl = None,
) -> None:
    """Compare two batches over the episodes that both have; 0: B is no worse than A; 1: worse; 4: not shown."""
    if as_json and markdown:
        raise typer.BadParameter("one of --json and --markdown; a comment is no JSON document")
    quiet, opened = as_json or markdown, open_existing_store(store)
    with waiting("both batches are read and compared"):
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
    store: StoreUrl = None,
) -> None:
    """Find the smallest world and the lowest seed in which a job still fails in the same way; write them as a case."""
    with waiting("smaller cases are simulated"):
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


def suite(
    batch: _Batch,
    *,
    output: Annotated[
        Path | None, typer.Option(help="The file to write. Default: suite-<batch>.yaml.", show_default=False)
    ] = None,
    store: StoreUrl = None,
) -> None:
    """Write the failures that a document's search has found and confirmed as a document that drives them again."""
    found = regression_suite(open_existing_store(store), batch)
    file = output or Path(f"suite-{found.batch}.yaml")
    file.write_text(found.text(), encoding="utf-8")
    echo(f"{file}: {len(found.failures)} failures")


def _pieces(minimal: bool) -> str:  # noqa: FBT001 - one flag, one word
    return " pieces, no single one of which can go" if minimal else " pieces; a larger --budget may leave fewer"


def show_comparison(found: Comparison, console: Console) -> None:
    """Shows the rates, the flips and the answer."""
    pairs = found.pairs
    table = Table(box=None, pad_edge=False)
    for heading in ("batch", "passed", "rate", f"{100 * found.confidence:g} % interval {found.where()}"):
        table.add_column(heading, no_wrap=heading == "batch")  # an id is copied
    for name, passed in ((found.first, pairs.first_passed), (found.second, pairs.second_passed)):
        sure = wilson(passed, pairs.pairs, found.confidence)
        rate = f"{passed / pairs.pairs:.3f}"
        table.add_row(name, f"{passed} of {pairs.pairs}", rate, f"{sure.lower:.3f} to {sure.upper:.3f}")
    console.print(table)
    for flip in pairs.flips[:FLIPS_SHOWN]:
        style = "green" if flip.gained else "red"
        console.print(Text(f"{'gained' if flip.gained else 'lost'}  {flip_text(flip)}", style=style), soft_wrap=True)
    if len(pairs.flips) > FLIPS_SHOWN:
        console.print(f"and {len(pairs.flips) - FLIPS_SHOWN} flips more; --json has all")
    for line in comparison_notes(found):
        console.print(Text(line), soft_wrap=True)
    if warned := comparison_warning(found):
        console.print(Text(warned, style="bold yellow"), soft_wrap=True)
    console.print(Text(comparison_answer(found), style=_STYLES[found.answer]), soft_wrap=True)


def comparison_comment(first: ComparedBatch, second: ComparedBatch, found: Comparison) -> str:
    """Returns a comparison as a comment for a pull request."""
    notes = [*filter(None, map(unvouched_notice, (first.work, second.work))), *comparison_notes(found)]
    option = store_option(second.work.store.url)

    def command(batch: ComparedBatch, index: int) -> str:
        return " ".join(filter(None, ["simyard replay", batch.job(index), option]))

    replays = (partial(command, first), partial(command, second))
    return comparison_markdown(found, [*filter(None, [comparison_warning(found)]), *notes], replays)


def show_replay(again: JobReplay, console: Console) -> None:
    """Shows each column that came of it beside the replay's, and the answer."""
    table = Table(box=None, pad_edge=False)
    for heading in ("column", "unit", "recorded", "replayed"):
        table.add_column(heading, overflow="fold")
    table.add_column("deviation", justify="right")
    for each in _deviations_shown(again):
        style = "" if each.same else "bold red"
        table.add_row(each.column, each.unit, each.recorded, each.replayed, _deviation(each), style=style)
    console.print(table)
    for line in replay_answer(again):
        console.print(Text(line, style="green" if again.same else "bold red"), soft_wrap=True)


def replay_answer(again: JobReplay) -> list[str]:
    """Returns whether the replay is what was recorded, and if not, what may be the cause."""
    deviating = [each for each in again.deviations if not each.same]
    if not deviating:
        hidden = len(again.deviations) - len(_deviations_shown(again))
        columns = f"{len(again.deviations)} columns, {hidden} of its request not shown"
        return [f"{again.job}: {again.ending}; deviation 0 in all {columns}"]
    most = ", ".join(f"{each.column} {_deviation(each)}" for each in deviating[:3])
    first = f"{again.job}: {again.ending}; {len(deviating)} of {len(again.deviations)} columns deviate: {most}"
    return [first, *(f"may be why: {cause}" for cause in again.causes or (_UNKNOWN,))]


def _deviations_shown(again: JobReplay) -> list[ColumnDeviation]:
    return [each for each in again.deviations if not (each.same and each.column in _ASKED)]


def _deviation(each: ColumnDeviation) -> str:
    if each.same:
        return "0"
    return "differs" if each.most in {0.0, float("inf")} else f"{each.most:.3g}"
