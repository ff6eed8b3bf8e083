"""What `simyard replay` tells: each column beside what was recorded, and why it may deviate."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from flows.replaying import Replayed
from tasks.results.deviations import Deviation
from tasks.results.schema import REQUESTED

# What it was asked for says nothing of what came of it.
_ASKED = frozenset(field.name for field in REQUESTED)
_UNKNOWN = "nothing that the record names has changed: please report this, with the batch's record"


def show_replay(again: Replayed, console: Console) -> None:
    """Shows each column that came of it beside the replay's, and the answer."""
    table = Table(box=None, pad_edge=False)
    for heading in ("column", "unit", "recorded", "replayed"):
        table.add_column(heading, overflow="fold")
    table.add_column("deviation", justify="right")
    for each in _shown(again):
        style = "" if each.same else "bold red"
        table.add_row(each.column, each.unit, each.recorded, each.replayed, _apart(each), style=style)
    console.print(table)
    for line in answer(again):
        console.print(Text(line, style="green" if again.same else "bold red"), soft_wrap=True)


def answer(again: Replayed) -> list[str]:
    """Returns whether the replay is what was recorded, and if not, what may be the cause."""
    apart = [each for each in again.deviations if not each.same]
    if not apart:
        hidden = len(again.deviations) - len(_shown(again))
        columns = f"{len(again.deviations)} columns, {hidden} of its request not shown"
        return [f"{again.job}: {again.ending}; deviation 0 in all {columns}"]
    most = ", ".join(f"{each.column} {_apart(each)}" for each in apart[:3])
    first = f"{again.job}: {again.ending}; {len(apart)} of {len(again.deviations)} columns deviate: {most}"
    return [first, *(f"may be why: {cause}" for cause in again.causes or (_UNKNOWN,))]


def _shown(again: Replayed) -> list[Deviation]:
    return [each for each in again.deviations if not (each.same and each.column in _ASKED)]


def _apart(each: Deviation) -> str:
    if each.same:
        return "0"
    return "differs" if each.most in {0.0, float("inf")} else f"{each.most:.3g}"
