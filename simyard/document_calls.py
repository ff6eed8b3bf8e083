"""What Python does with a document: `run`, `plan`, `validate`. Each imports what it needs when it is called."""
# ruff: noqa: PLC0415 - see above

import json
import os
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from simyard.answer.run_answers import Plan, Run
    from specs.pipeline.document import PipelineSpec

    DocumentLike = str | os.PathLike[str] | Mapping[str, object] | PipelineSpec

Place = str | os.PathLike[str]
Progress = Callable[[str, int, int], None]


def store_url(place: str | os.PathLike[str] | None) -> str | None:
    """Returns the URL of a store.

    Args:
        place: A URL or a folder; None means SIMYARD_STORE, else ``.simyard`` in the working directory.
    """
    if place is None or (isinstance(place, str) and "://" in place):
        return place
    return Path(place).resolve().as_uri()


class _Read(NamedTuple):
    """A document as it was read: where from, for messages, and the folder that its paths start from."""

    spec: "PipelineSpec"
    source: str
    base: Path


def run(
    document: "DocumentLike",
    *,
    base: Place | None = None,
    store: Place | None = None,
    direct: bool = False,
    progress: Progress | None = None,
) -> "Run":
    """Runs a document from its first section to its last, and returns what came of it, passed or not.

    A run that was killed is continued. It uses the Prefect server that `PREFECT_API_URL` names, else the one that
    `simyard up` keeps, else one that lives as long as the call; inside a flow of yours it is a sub-flow.

    Args:
        document: A path; YAML or JSON as text; a dictionary; or what `validate` returns.
        base: Folder that the document's relative paths start from: the file's own, else the working directory.
        store: `file:///folder`, `s3://bucket/prefix` or a folder; SIMYARD_STORE, else `.simyard` in the working
            directory.
        direct: Without a Prefect server: no pages, artifacts, events, or workers.
        progress: Called with a stage's name, how much of it is done, and how much there is.

    Raises:
        DocumentError: The document is wrong; with all its faults.
        StageFailed: A stage failed. A gate or a deployment that did not pass raises nothing: see `Run.passed`.
    """
    from simyard.answer.run_answers import Run
    from simyard.run_call import run_directly, run_under_prefect
    from specs.errors import PipelineNotPassed
    from tasks.progress.listener import current_listener, listen_to_progress
    from tasks.storage.store_url import open_store

    read = _read(document, base)
    with _name_source(read.source), listen_to_progress(progress or current_listener()):
        place = open_store(store_url(store)).url
        begin = run_directly if direct else run_under_prefect
        try:
            return Run(begin(read.spec, read.base, place), place)
        except PipelineNotPassed as exc:
            return Run(exc.report, place)


def plan(
    document: "DocumentLike",
    *,
    base: Place | None = None,
    store: Place | None = None,
) -> "Plan":
    """Returns what a run of the document would do, and what in it has no effect.

    Args:
        document: As for `run`, and so are `base` and `store`.
        base: See there.
        store: See there.

    Raises:
        DocumentError: The document is wrong, or refers to what does not exist; with all its faults.
    """
    from flows.preview.plan import plan_lines
    from simyard.answer.run_answers import Plan
    from tasks.storage.store_url import open_store

    read = _read(document, base)
    with _name_source(read.source):
        return Plan(read.spec.name, tuple(plan_lines(read.spec, read.base, open_store(store_url(store)))))


def validate(document: "DocumentLike", *, base: Place | None = None) -> "PipelineSpec":
    """Returns the document, checked, with its defaults.

    Args:
        document: As for `run`, and so is `base`.
        base: See there.

    Raises:
        DocumentError: The document is wrong; with all its faults.
    """
    from flows.pipeline.bundle_checks import check_robot_files

    read = _read(document, base)
    with _name_source(read.source):
        check_robot_files(read.spec, read.base)
    return read.spec


def _read(document: "DocumentLike", base: Place | None) -> _Read:
    from specs.pipeline.document import PipelineSpec
    from tasks.documents.pipeline_file import pipeline_of, read_pipeline
    from tasks.documents.source_text import decode_source_text

    folder = Path.cwd() if base is None else Path(base)
    if isinstance(document, PipelineSpec):
        return _Read(document, document.name, folder)
    if isinstance(document, Mapping):
        body, notation = _json(document), "document.json"
    elif isinstance(document, str) and _is_text(document):
        body, notation = document.encode(), "document.yaml"
    else:
        path = Path(document)
        if base is None:
            return _Read(read_pipeline(path), str(path), path.resolve().parent)
        from tasks.documents.source_text import read_document

        return _Read(pipeline_of(read_document(path), path, folder), str(path), folder)
    with _name_source("document"):
        return _Read(pipeline_of(decode_source_text(body, notation), Path("document"), folder), "document", folder)


def _is_text(document: str) -> bool:
    """Returns whether a text is a document, and no path: a path has no line ends, and does not begin with a brace."""
    return "\n" in document or document.lstrip().startswith("{")


def _json(document: Mapping[str, object]) -> bytes:
    from specs.errors import DocumentError

    try:
        return json.dumps(document, ensure_ascii=False, default=_plain).encode("utf-8", "surrogatepass")
    except (TypeError, ValueError, RecursionError) as exc:
        raise DocumentError.of("document", str(exc), "texts, numbers, true, false, lists and dictionaries") from exc


def _plain(value: object) -> object:
    """Returns a path as text, and what NumPy or a part of a document holds as plain data."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    for name in ("tolist", "model_dump"):
        if method := getattr(value, name, None):
            return method()
    if isinstance(value, Mapping):
        return {**value}
    raise TypeError(f"{type(value).__name__} is no data of a document")


@contextmanager
def _name_source(source: str) -> Generator[None, None, None]:
    """Names the document in the faults of what it refers to."""
    from specs.errors import DocumentError

    try:
        yield
    except DocumentError as exc:
        if exc.source == source:
            raise
        raise type(exc)(exc.faults, source) from exc
