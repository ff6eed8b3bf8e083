"""How far each stage is: bars in a terminal, lines in a file, a pipe or the log of a CI."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from tasks.progress.listener import Listener

_LINE_EVERY_S = 10.0


@contextmanager
def progress_bars(console: Console) -> Generator[Listener, None, None]:
    """Yields what shows how far each stage is on the console, until the block ends."""
    if not console.is_terminal:
        yield ProgressLines(console).listen
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<20}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        bars: dict[str, TaskID] = {}

        def listen(stage: str, done: int, total: int) -> None:
            if stage not in bars:
                bars[stage] = progress.add_task(stage, total=total)
            progress.update(bars[stage], completed=done, total=total)

        yield listen


class ProgressLines:
    """A line when a stage begins, at its end, and now and then between: what is written stays."""

    def __init__(self, console: Console, now_s: Callable[[], float] = time.monotonic) -> None:
        """Begins to count the time.

        Args:
            console: Where lines are printed.
            now_s: The time.
        """
        self._console, self._now_s = console, now_s
        self._begin_s = now_s()
        self._told: dict[str, tuple[int, int]] = {}
        self._told_s: dict[str, float] = {}

    def listen(self, stage: str, done: int, total: int) -> None:
        """Prints how far a stage is, if that is new."""
        now_s, before = self._now_s(), self._told.get(stage)
        if before == (done, total):
            return
        if before is not None and done < total and now_s - self._told_s[stage] < _LINE_EVERY_S:
            return
        self._told[stage], self._told_s[stage] = (done, total), now_s
        line = f"{now_s - self._begin_s:6.1f} s  {stage} {done:,}/{total:,}"
        self._console.print(line, markup=False, highlight=False)
