"""The terminal output of `simyard compare` and `simyard replay`."""

from functools import partial

from rich.console import Console
from rich.table import Table
from rich.text import Text

from flows.batch.compare_batches import ComparedBatch
from flows.batch.replay_episode import JobReplay
from flows.cli.ci_report import store_option
from specs.data.result_columns import REQUESTED
from tasks.results.batch_comparison import (
    Comparison,
    comparison_answer,
    comparison_notes,
    comparison_warning,
    flip_text,
)
from tasks.results.ci.github import comparison_markdown
from tasks.results.playback.playback import ColumnDeviation
from tasks.results.statistics.intervals import wilson
from tasks.simulate.batch.provenance import unvouched_notice

FLIPS_SHOWN = 40
# What it was asked for says nothing of what came of it.
_ASKED = frozenset(field.name for field in REQUESTED)
_UNKNOWN = "nothing that the record names has changed: please report this, with the batch's record"
_STYLES = {"NO WORSE": "bold green", "WORSE": "bold red", "INCONCLUSIVE": "bold yellow"}


def show_comparison(found: Comparison, console: Console) -> None:
    """Shows the rates, the flips and the answer."""
    pairs = found.pairs
    table = Table(box=None, pad_edge=False)
    for heading in ("batch", "passed", "rate", f"{100 * found.confidence:g} % interval {found.where()}"):
        table.add_column(heading)
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
    apart = [each for each in again.deviations if not each.same]
    if not apart:
        hidden = len(again.deviations) - len(_deviations_shown(again))
        columns = f"{len(again.deviations)} columns, {hidden} of its request not shown"
        return [f"{again.job}: {again.ending}; deviation 0 in all {columns}"]
    most = ", ".join(f"{each.column} {_deviation(each)}" for each in apart[:3])
    first = f"{again.job}: {again.ending}; {len(apart)} of {len(again.deviations)} columns deviate: {most}"
    return [first, *(f"may be why: {cause}" for cause in again.causes or (_UNKNOWN,))]


def _deviations_shown(again: JobReplay) -> list[ColumnDeviation]:
    return [each for each in again.deviations if not (each.same and each.column in _ASKED)]


def _deviation(each: ColumnDeviation) -> str:
    if each.same:
        return "0"
    return "differs" if each.most in {0.0, float("inf")} else f"{each.most:.3g}"
