"""The commands `simyard run`, `plan` and `validate`. Each imports what it needs when it runs."""
# ruff: noqa: PLC0415 - see above

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from flows.cli.terminal import StoreUrl, TerminalConsole, echo, exit_code_of, go_on_unread, show_report
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, PipelineNotPassed, SimyardError

if TYPE_CHECKING:
    from pydantic import JsonValue

    from specs.base import Fault
    from specs.pipeline.document import PipelineSpec

Document = Annotated[Path, typer.Argument(help="The pipeline document, YAML or JSON.", show_default=False)]


def run(
    file: Document,
    *,
    store: StoreUrl = None,
    direct: Annotated[
        bool, typer.Option("--direct", help="Without a Prefect server: no pages, artifacts, events, or other workers.")
    ] = False,
    junit: Annotated[
        Path | None, typer.Option(help="Write a JUnit file, however the run ends.", show_default=False)
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the whole report as one JSON document; all else goes to stderr.")
    ] = False,
) -> None:
    """Run a document from its first section to its last; continues a run that was killed."""
    from flows.prefect.prefect_server import server_in_reserve

    go_on_unread()
    with nullcontext() if direct else server_in_reserve():  # which starts while the rest is imported
        from flows.cli.run_command import AskedRun, CiWishes, run_directly, run_document, tell_ci
        from tasks.storage.store_url import chosen_url

        console, document = TerminalConsole(stderr=as_json), _read(file)
        name = file.stem if isinstance(document, DocumentError) else document.name
        try:
            with tell_ci(CiWishes(file, AskedRun(name, chosen_url(store)), junit, as_json)) as tell:
                if isinstance(document, DocumentError):
                    raise document
                with _name_file(file):
                    begin = run_directly if direct else run_document
                    report = begin(document, file.resolve().parent, store, console)
                tell(report)
        except PipelineNotPassed as exc:
            show_report(exc.report, console)
            _show_next_steps(exc.report, store, console)
            raise typer.Exit(exit_code_of(exc)) from exc
        show_report(report, console)
        if any(stage.name == "simulationBatch" for stage in report.stages):  # others have no episodes that failed
            _show_next_steps(report, store, console)


def _show_next_steps(report: PipelineReport, store: str | None, console: Console) -> None:
    from flows.cli.ci_report import next_steps
    from tasks.storage.store_url import open_store

    try:
        lines = next_steps(report, open_store(store))
    except SimyardError as exc:  # the exit code is the run's, whatever the store says now
        lines = [f"no next steps: {exc}"]
    for line in lines:
        console.print(line, soft_wrap=True, highlight=False)


def _read(file: Path) -> "PipelineSpec | DocumentError":
    """Returns the document, or what is wrong with it, which CI is told of as well."""
    from tasks.documents.pipeline_file import read_pipeline

    try:
        return read_pipeline(file)
    except DocumentError as exc:
        return exc


def plan(file: Document, store: StoreUrl = None) -> None:
    """Tell what a run of the document would do, and what in it has no effect."""
    from flows.preview.plan import plan_lines
    from tasks.documents.pipeline_file import read_pipeline
    from tasks.storage.store_url import open_store

    spec = read_pipeline(file)
    with _name_file(file):
        for line in plan_lines(spec, file.resolve().parent, open_store(store)):
            echo(line)


def validate(
    file: Document,
    store: Annotated[
        str | None,
        typer.Option("--store", help="Also look up what the document refers to, in this store.", show_default=False),
    ] = None,
) -> None:
    """Check a document, or a template alone, and tell all its faults at once."""
    from flows.pipeline.bundle_checks import check_own_bundles, unchecked_references
    from flows.pipeline.robot_drafts import with_drafts
    from flows.pipeline.world_imports import check_world_files
    from specs.template.body import TemplateBody
    from tasks.documents.parse import parse
    from tasks.documents.pipeline_file import is_template, pipeline_of
    from tasks.documents.source_text import read_document
    from tasks.results.gate.shipped_builds import check_variables

    data = read_document(file)
    if is_template(data):
        from tasks.worlds.unused_sets import unused_sets

        template = parse(TemplateBody, data, str(file))
        rooms = len(template.Buildings[0].Floors[0].Floorplan.Rooms)
        echo(f"{file}: a template of version {template.Version} with {rooms} room{'' if rooms == 1 else 's'}: valid")
        for line in unused_sets(template):
            echo(f"no effect: {line}")
        return
    folder, checks = file.resolve().parent, (check_variables, check_world_files, *_references_in(store))
    try:
        spec = pipeline_of(data, file, file.parent)
    except DocumentError as exc:
        raise DocumentError([*exc.faults, *_faults_of_the_rest(data, exc, file)], str(file)) from exc
    with _name_file(file):
        drafted = with_drafts(spec, folder)
        notes = check_own_bundles(drafted.spec, folder, checks)
    echo(f"{file}: {spec.name}: valid")
    for note in (*notes, *drafted.notes):
        echo(note)
    if not store and (left := unchecked_references(spec)):
        echo(f"not looked up, because only the store knows: {', '.join(left)}; simyard plan {file} does, or --store")


_ROUNDS = 20  # each leaves out a section, or as many unknown ones as are told at once


def _faults_of_the_rest(data: "JsonValue", wrong: DocumentError, file: Path) -> "Sequence[Fault]":
    """Returns what is wrong with the bundles of a document that is wrong in itself, as far as it says which they are.

    Looked at is the document less the values at fault, and less the sections that are not whole without them.
    """
    from flows.pipeline.bundle_checks import check_own_bundles
    from flows.pipeline.robot_drafts import with_drafts
    from tasks.documents.pipeline_file import without

    known, folder = tuple(fault.path for fault in wrong.faults), file.resolve().parent
    spec = _sound_part(without(data, known), file)
    try:
        if spec:
            check_own_bundles(with_drafts(spec, folder).spec, folder)
    except DocumentError as exc:
        return [fault for fault in exc.faults if not fault.path.startswith(known)]
    except SimyardError:  # such as a full disk: it is met again by whoever has put right what is told now
        return ()
    return ()


def _sound_part(data: "JsonValue", file: Path) -> "PipelineSpec | None":
    """Returns a document less the sections that are not whole; None if nothing is left."""
    from tasks.documents.pipeline_file import pipeline_of

    for _ in range(_ROUNDS):
        try:
            return pipeline_of(data, file, file.parent)
        except DocumentError as exc:
            places, sections = [fault.path for fault in exc.faults], data if isinstance(data, dict) else {}
            wrong = {name for name in sections if any(place.startswith(name) for place in places)}
            data = {name: each for name, each in sections.items() if name not in wrong}
    return None


def _references_in(store: str | None) -> "Sequence[Callable[[PipelineSpec, Path], object]]":
    """Returns what looks up a document's references in a store, without a change to it; nothing where none is named."""
    if not store:
        return ()
    from flows.pipeline.references import resolve_references
    from tasks.storage.backends.overlay import OverlayStore
    from tasks.storage.store_url import open_existing_store

    opened = open_existing_store(store)
    return (lambda spec, base: resolve_references(spec, OverlayStore(opened), base),)


@contextmanager
def _name_file(file: Path) -> Generator[None, None, None]:
    """Names the file in the faults of what its document refers to."""
    try:
        yield
    except DocumentError as exc:
        raise type(exc)(exc.faults, str(file)) from exc
