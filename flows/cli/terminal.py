"""What `simyard` prints and ends with: tables, JSON lines for programs, exit codes, and the answer to signals.

All that a command prints goes through ``echo``, ``echo_json`` or a ``TerminalConsole``: whatever a stranger wrote into
the store, it neither steers the terminal nor is read as rich's markup.

Exit codes: 0: done and passed. 1: not passed: the gate says FAIL, the deployment failed, a replay deviates, or a batch
is worse than another. 2: a bad document or command. 3: a stage failed, or Simyard has a defect. 4: INCONCLUSIVE: a gate
or a comparison has too few episodes to say. 130 and 143: interrupted. 141: whoever read what was printed is gone, which
ends any command but a run. Nothing else ends with 1 or 4, so that a script can tell a verdict from an accident, and a
bad robot from a small batch.
"""

import atexit
import errno
import logging
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from select import select
from threading import Event, Lock, Thread
from types import FrameType
from typing import IO, Annotated, NoReturn

import typer
from pydantic import JsonValue
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from specs.arn import parse_reference
from specs.base import Spec
from specs.data.run_report import PipelineReport
from specs.errors import NO_SOURCE, DocumentError, PipelineNotPassed, SimyardError
from specs.untrusted_text import terminal_json, terminal_line, terminal_text, without_commands
from tasks.progress.listener import waiting_for
from tasks.storage.base.local_files import NO_ROOM, full_machine_message

StoreUrl = Annotated[
    str | None,
    typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
]
"""The option `--store` of every command that has one."""
_WIDEST = 10_000
_LONGEST_CELL = 80
_GOOD = frozenset({"Completed", "Succeeded", "PASS", "InSync"})
_UNDECIDED = frozenset({"PartialFailed", "INCONCLUSIVE", "Pending", "InProgress", "Running", "Preparing"})


class TerminalConsole(Console):
    """A console that reads no markup, and prints no character that steers a terminal but those of its own styles."""

    def __init__(self, *, stderr: bool = False, file: IO[str] | None = None, width: int | None = None) -> None:
        """Writes to the terminal.

        Args:
            stderr: Whether to stderr.
            file: Where else, if anywhere.
            width: In characters; the terminal's own, if left out.
        """
        super().__init__(stderr=stderr, file=file, width=width, markup=False, emoji=False)

    def on_broken_pipe(self) -> None:
        """Answers that whoever read the console is gone."""
        _lose_reader(self.file)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yields what is printed; moving the cursor is no text, and stays."""
        before = ""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
                continue
            # What is an order may come in parts: rich ends a segment wherever the style changes.
            text = _text(before + segment.text)[len(before) :]
            before = (before + text)[-2:]
            yield Segment(text, segment.style)


def echo(text: object, *, err: bool = False) -> None:
    """Prints a text to stdout or stderr, without what steers a terminal."""
    _write(_text(str(text)), err=err)


def echo_commands(line: str) -> None:
    """Prints a line that GitHub's runner obeys, as it is, to stderr: stdout may be a document."""
    _write(line, err=True)


def echo_json(text: str) -> None:
    """Prints JSON to stdout; what steers a terminal or a runner is escaped, so that programs read the same."""
    _write(terminal_json(text).replace("##[", "\\u0023#["))


def waiting(what: str) -> AbstractContextManager[None]:
    """Says on stderr what the block waits for, if it takes long."""
    return waiting_for(what, lambda line: echo(line, err=True))


def go_on_unread() -> None:
    """Lets this process do all of its work even if whoever reads what it prints goes away, as `head -1` does."""
    _goes_on.set()


_goes_on = Event()


def _write(text: str, *, err: bool = False) -> None:
    try:
        typer.echo(text, err=err)
    except BrokenPipeError:
        _lose_reader(sys.stderr if err else sys.stdout)


def _lose_reader(stream: IO[str]) -> None:
    """Prints nowhere from now on; ends the command if it is one that is there to be read."""
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - a device
        os.dup2(nowhere.fileno(), stream.fileno())
    if stream.fileno() != sys.stdout.fileno():
        return
    if not _goes_on.is_set():
        raise SystemExit(_UNREAD)
    echo("whoever read what this prints is gone; the run goes on to its end", err=True)


def show_report(report: PipelineReport, console: Console) -> None:
    """Shows a run: a line a stage, where its artefacts lie, and the answer."""
    table = Table(title=Text(f"{report.name} ({report.run})"), title_justify="left")
    table.add_column("stage")
    table.add_column("status")
    table.add_column("what came of it", overflow="fold")  # a path is copied
    table.add_column("seconds", justify="right")
    for stage in report.stages:
        table.add_row(Text(stage.name), _status(stage.status), Text(stage.summary), f"{stage.seconds:.1f}")
    console.print(table)
    for stage in report.stages:
        if stage.arn:
            _line(console, stage.name, stage.arn)
        for artefact in stage.artefacts:
            _line(console, f"  {artefact.label}", artefact.url)
    alarms = (line for stage in report.stages for line in str(stage.facts.get("alarm", "")).splitlines())
    for alarm in dict.fromkeys(alarms):  # batch and gate may warn of the same
        console.print(Text(alarm, style="bold red"), soft_wrap=True)
    console.print(_answer(report))


def show_rows(rows: Sequence[Mapping[str, JsonValue]], console: Console) -> None:
    """Shows rows under headings: each thing's own ARN, whole, and what fits beside it; `--json` has everything.

    On a terminal that is narrower than all of it, ids stand for ARNs, and what still does not fit is left out by name.
    """
    shown = [{key: value for key, value in row.items() if _fits(key, value)} for row in rows]
    names = dict.fromkeys(key for row in shown for key in row)
    whole = {name: [_cell(name, row.get(name)) for row in shown] for name in names}
    narrow = console.is_terminal and _width(whole) > console.width
    columns = _narrow(whole, console.width) if narrow else whole
    table = Table(box=None, pad_edge=False)
    for name in columns:
        table.add_column(Text(name), no_wrap=True)
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    # As wide as its content: a terminal may wrap a line, but nothing is cut off.
    TerminalConsole(file=console.file, width=_WIDEST).print(table, soft_wrap=True)
    known = [*columns.values()][:1]  # by ids, or by names that are the same
    if left_out := ", ".join(name for name in names if name not in {"arn", *columns} and whole[name] not in known):
        echo(f"left out, for want of width: {left_out}; a pipe has all: | less -S", err=True)


def _narrow(columns: Mapping[str, Sequence[Text]], width: int) -> dict[str, Sequence[Text]]:
    """Returns as many columns as fit, in their order: states first chosen, times and counts last."""
    found = dict(columns)
    if "arn" in found:
        found = {"id": [Text(parse_reference(cell.plain).path) for cell in found.pop("arn")], **found}
    first = next(iter(found))
    kept = {first}
    for name in sorted(found, key=lambda name: (name != "status", name.endswith(("At", "Time", "Count")))):
        repeats = name != first and found[name] == found[first]
        if not repeats and _width({each: found[each] for each in found if each in {*kept, name}}) <= width:
            kept.add(name)
    return {name: found[name] for name in found if name in kept}


def _width(columns: Mapping[str, Sequence[Text]]) -> int:
    widths = (max(len(name), *(cell.cell_len for cell in cells)) for name, cells in columns.items())
    return sum(widths) + len("  ") * (len(columns) - 1)


def page_rows(page: Spec) -> tuple[list[dict[str, JsonValue]], str | None]:
    """Returns the rows of a List call's answer, and the token of the next page; None on the last."""
    document = page.model_dump(mode="json", exclude_none=True)
    token = document.pop("nextToken", None)
    return [row for rows in document.values() for row in rows], token


def json_lines(documents: Iterable[Spec]) -> Iterable[str]:
    """Yields each document as one line of JSON, without the fields that say nothing."""
    for document in documents:
        yield document.model_dump_json(exclude_none=True)


def _line(console: Console, label: str, url: str) -> None:
    console.print(Text(f"{label:<22} {url}"), soft_wrap=True)


def _status(status: str) -> Text:
    style = "green" if status in _GOOD else "yellow" if status in _UNDECIDED else "red"
    return Text(status, style=style)


def _answer(report: PipelineReport) -> Text:
    if report.passed and report.verdict is None and any(stage.name == "simulationBatch" for stage in report.stages):
        return Text(
            "Done. No gate was asked for, so nobody judged the batch: look at its numbers.", style="bold yellow"
        )
    rolled = next((stage for stage in report.stages if stage.name == "deployment"), None)
    standing = rolled.summary.partition("; ")[0] if rolled else ""
    if report.passed and rolled and "behind" in rolled.facts:
        why = "as many may fail; simyard fleet watch tells who, and why"
        return Text(_text(f"Done, and {standing}: {why}."), style="bold yellow")
    unmet = next((stage.facts["unmet_wishes"] for stage in report.stages if "unmet_wishes" in stage.facts), None)
    if report.passed and unmet:
        said = f"Done, but wishes of the template that its worlds do not fulfil: {unmet}; the contact sheet shows them."
        return Text(said, style="bold yellow")
    if report.passed:
        return Text("Done, and everything that was asked for passed.", style="bold green")
    if report.verdict not in (None, "PASS"):
        left = "" if report.shipped is None else ": nothing was deployed"
        return Text(f"The gate says {report.verdict}{left}.", style="bold red")
    return Text(_text(": ".join(filter(None, ("The deployment failed", standing))) + "."), style="bold red")


def _text(text: str) -> str:
    """Returns a text for the terminal; in GitHub Actions also without what the runner would take for an order."""
    shown = terminal_text(text)
    return without_commands(shown) if os.environ.get("GITHUB_ACTIONS") == "true" else shown


def _fits(column: str, value: JsonValue) -> bool:
    if isinstance(value, (list, dict)):
        return False
    return column == "arn" or not (isinstance(value, str) and value.startswith("arn:"))


def _cell(column: str, value: JsonValue) -> Text:
    if value is None:
        return Text("")
    if column.endswith(("At", "Time")) and isinstance(value, float):
        return Text(datetime.fromtimestamp(value, tz=UTC).isoformat(sep=" ", timespec="seconds"))
    line = terminal_line(str(value))
    if column != "arn" and len(line) > _LONGEST_CELL:  # one long reason would pad all rows with blanks
        line = f"{line[:_LONGEST_CELL]}..."
    return _status(line) if column == "status" else Text(line)


NOT_PASSED, REFUSED, FAILED, UNDECIDED = 1, 2, 3, 4
_VARIABLE = re.compile(r"\b[A-Z][A-Z0-9]*_[A-Z0-9_]+\b")
_OF_SHELLS = frozenset({"PWD", "OLDPWD", "_"})
_UNREAD = 128 + signal.SIGPIPE
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_INTERRUPTED = tuple(128 + number for number in _SIGNALS)
_GO_ON = "interrupted; the same command continues this run if the document is unchanged"
# Agents, the server and Prefect's last messages may take this long to come to their end.
_GRACE_S = 30.0
# One Ctrl-C may come twice, from the terminal and from a program that simyard was started by.
_SAME_KEY_S = 0.5


def exit_code_of(failure: Exception) -> int:
    """Returns the exit code of a command that this ends."""
    if isinstance(failure, PipelineNotPassed):
        return UNDECIDED if failure.report.undecided else NOT_PASSED
    return REFUSED if isinstance(failure, DocumentError) else FAILED


@contextmanager
def exit_with_code(grace_s: float = _GRACE_S) -> Generator[None, None, None]:
    """Ends the process with Simyard's exit code after a command, the block; says on stderr why it failed, if it did.

    The command may end the process itself, as the parser does after a usage error.

    Args:
        grace_s: How long an interrupted command may take to leave before the process is ended under it.
    """
    code = 0
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as in `nohup` and for jobs in a script's background
            signal.signal(number, _on_signal)
    with _watch_signals(grace_s) as heard:
        try:
            yield
        except SimyardError as exc:
            _complain(_complaint(exc))
            code = exit_code_of(exc)
        except BaseException as exc:  # the outermost frame: Python would exit with 1, which means a failed gate
            if isinstance(exc, SystemExit) and isinstance(exc.__context__, BrokenPipeError):
                sys.exit(_UNREAD)  # the parser's own answer to it is 1
            if isinstance(exc, SystemExit) and exc.code not in _INTERRUPTED:
                raise
            number = heard()
            if number is None and not isinstance(exc, Exception):
                raise
            # Prefect answers signals with exceptions of its own.
            _complain(_GO_ON if number is not None else _accident(exc))
            code = FAILED if number is None else 128 + number
    sys.exit(code)


@contextmanager
def end_process(grace_s: float = _GRACE_S) -> Generator[None, None, None]:
    """Does what ``exit_with_code`` does, and ends the process soon after, for its outermost frame."""
    codes: list[int] = []
    atexit.register(_end_unfreed, codes)  # before any library registers what it does at the exit, so that this is last
    try:
        with exit_with_code(grace_s):
            yield
    except SystemExit as exc:
        codes.append(exc.code if isinstance(exc.code, int) else int(exc.code is not None))
        _guard_shutdown(codes[0], grace_s)
        raise


def _end_unfreed(codes: list[int]) -> None:
    """Ends the process when all else is done: to free each object of Prefect's takes half a second of the processor."""
    try:
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):  # Python itself has an exit code for that
        return
    for code in codes:
        os._exit(code)


def _guard_shutdown(code: int, grace_s: float) -> None:
    """Ends the process soon, even if a thread of a library never ends, such as one that polls a dead server."""

    def end() -> None:
        time.sleep(grace_s)
        os._exit(code)

    Thread(target=end, name="simyard shutdown", daemon=True).start()


def _complaint(exc: SimyardError) -> str:
    """Returns the error; faults of no document without the heading of one."""
    if isinstance(exc, DocumentError) and exc.source == NO_SOURCE:
        return "\n".join(map(str, exc.faults))
    return str(exc)


def _accident(exc: BaseException) -> str:
    if isinstance(exc, OSError) and exc.errno in NO_ROOM:
        return full_machine_message(exc)
    if isinstance(exc, OSError) and exc.errno == errno.EROFS:
        return f"{exc.strerror}: {exc.filename or 'a disk of this machine'}; make it writable, or choose another folder"
    if isinstance(exc, FileNotFoundError) and not _is_somewhere():
        return "the folder that this command was called in is gone: cd to one that is there"
    if os.environ.get("SIMYARD_DEBUG") == "1":
        TerminalConsole(stderr=True).print_exception()
    if named := [name for name in _VARIABLE.findall(str(exc)) if name in os.environ]:
        return f"{' '.join(str(exc).split())}; look at the environment variable {named[0]}, which is set"
    if isinstance(exc, OSError) and (names := _variables_of(exc)):
        return f"{exc.filename}: {exc.strerror}; the environment variable {names[-1]} leads there"
    what = " ".join(f"{type(exc).__name__}: {exc}".split())
    return f"this is a defect of Simyard: {what} (SIMYARD_DEBUG=1 shows where)"


def _variables_of(exc: OSError) -> list[str]:
    """Returns the variables that name a file or a folder that this is about, that of the longest path last."""
    place = Path(os.fsdecode(exc.filename)) if isinstance(exc.filename, str | bytes) else None
    named = {name: Path(value) for name, value in os.environ.items() if os.path.isabs(value) and name not in _OF_SHELLS}  # noqa: PTH117 - no path, mostly
    found = [name for name, folder in named.items() if place and place.is_relative_to(folder) and folder != Path("/")]
    return sorted(found, key=lambda name: (len(str(named[name])), name))


def _is_somewhere() -> bool:
    try:
        return bool(Path.cwd())
    except FileNotFoundError:
        return False


def _on_signal(number: int, _frame: FrameType | None) -> NoReturn:
    # Not KeyboardInterrupt: the parser takes that for itself and says nothing.
    raise SystemExit(128 + number)


@contextmanager
def _watch_signals(grace_s: float) -> Generator[Callable[[], int | None], None, None]:
    """Yields a function that returns the last signal of ours that came.

    Ends the process if the block goes on for long after one, or at once when Ctrl-C comes again.

    A handler's exception may be caught, and Prefect puts handlers of its own in place of ours; but Python writes the
    number of each signal to a pipe, and this reads it there.
    """
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    os.set_blocking(writing, False)
    hearing = _SignalPipe(reading)
    watching = Thread(target=hearing.watch, args=(grace_s,), name="simyard signals", daemon=True)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    watching.start()
    try:
        yield hearing.last
    finally:
        hearing.left.set()
        signal.set_wakeup_fd(before)
        with suppress(BlockingIOError):
            os.write(writing, b"\0")  # wakes the thread, so that it ends
        watching.join()
        os.close(reading)
        os.close(writing)


class _SignalPipe:
    """The signals that came, read from a pipe by the first thread that asks."""

    def __init__(self, pipe: int) -> None:
        self.left = Event()
        self._pipe, self._numbers, self._one_reads = pipe, list[int](), Lock()

    def last(self) -> int | None:
        with self._one_reads, suppress(BlockingIOError):
            self._numbers += [number for number in os.read(self._pipe, 1 << 12) if number in _SIGNALS]
        return self._numbers[-1] if self._numbers else None

    def watch(self, grace_s: float) -> None:
        while self.last() is None and not self.left.is_set():
            select([self._pipe], [], [])
        end_s = time.monotonic() + grace_s
        self.left.wait(_SAME_KEY_S)
        self.last()
        keys = self._numbers.count(signal.SIGINT)
        while not self.left.is_set():
            ready = select([self._pipe], [], [], max(0.0, end_s - time.monotonic()))[0]
            number = self.last()
            # Only Ctrl-C is impatience: Prefect sends its process each SIGTERM once more.
            again = self._numbers.count(signal.SIGINT) > keys
            if number is not None and not self.left.is_set() and (again or not ready):
                _end_now(number)


def _end_now(number: int) -> None:
    sys.stderr.write(f"\n{_GO_ON}\n")
    sys.stderr.flush()
    os._exit(128 + number)


def _complain(about: object) -> None:
    TerminalConsole(stderr=True).print(Text(str(about), style="red"), soft_wrap=True)
