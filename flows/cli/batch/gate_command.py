"""The command `simyard gate`. It imports what it needs when it runs."""
# ruff: noqa: PLC0415 - see above

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from flows.cli.exit_codes import NOT_PASSED, UNDECIDED, exit_code_of
from flows.cli.output import TerminalConsole, echo, echo_json
from specs.errors import SimyardError

_STYLES = {"PASS": "bold green", "FAIL": "bold red", "INCONCLUSIVE": "bold yellow"}


def gate(
    batch: Annotated[
        str,
        typer.Argument(metavar="BATCH", help="A simulation job batch or a run of a document: its ARN or id."),
    ],
    *,
    document: Annotated[
        Path, typer.Option("--document", help="The document whose section gate judges.", show_default=False)
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    junit: Annotated[Path | None, typer.Option(help="Write a JUnit file.", show_default=False)] = None,
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Judge a batch that has ended by a document's gate, without simulating; 0 PASS, 1 FAIL, 4 INCONCLUSIVE."""
    from flows.batch.judge_again import judge_again
    from tasks.documents.pipeline_file import read_pipeline
    from tasks.storage.store_url import open_existing_store

    opened, spec = open_existing_store(store), read_pipeline(document)
    with _told_of_failure(junit, spec.name, opened.url):
        found = judge_again(opened, batch, spec)
    if as_json:
        echo_json(found.model_dump_json(indent=2))
    else:
        console = TerminalConsole()
        for number, line in enumerate(found.lines()):
            style = _STYLES[found.verdict] if number == 0 else "bold yellow" if line in found.warnings else ""
            console.print(Text(line, style=style), soft_wrap=True)
        echo(f"evidence {found.evidence.url}")
        echo("this is a later judgement and ships nothing: to deploy, run the document")
    if found.notice:
        echo(found.notice, err=True)
    code = {"PASS": 0, "FAIL": NOT_PASSED, "INCONCLUSIVE": UNDECIDED}[found.verdict]
    if junit:
        from flows.ci.run_report import report_of_judgement
        from flows.cli.document.ci_answers import write_asked_junit

        write_asked_junit(junit, report_of_judgement(opened, spec, found, code))
    raise typer.Exit(code)


@contextmanager
def _told_of_failure(junit: Path | None, document: str, store_url: str) -> Generator[None, None, None]:
    """Leaves why in the JUnit file if the block fails, and never an older file."""
    if junit is None:
        yield
        return
    from flows.ci.run_files import AskedRun, prepare_junit
    from flows.ci.run_report import report_of_failure
    from flows.cli.document.ci_answers import write_asked_junit

    asked = AskedRun(document, store_url)
    prepare_junit(junit, asked)
    try:
        yield
    except SimyardError as exc:
        write_asked_junit(junit, report_of_failure(asked, exc, exit_code_of(exc)))
        raise
