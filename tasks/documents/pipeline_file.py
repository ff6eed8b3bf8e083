"""Reads a pipeline document together with the files beside it that it names."""

from pathlib import Path

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.rules import items, part
from specs.template.body import TemplateBody
from tasks.documents.bare_requests import is_simulation_request, pipeline_of_request
from tasks.documents.parse import parse
from tasks.documents.shape_text import same_word
from tasks.documents.source_text import read_document

_TEMPLATE_KEYS = ("templateBody", "Version", "Buildings", "Floors", "Floorplan", "Interior", "Rooms")
_BARE_REQUESTS = {
    "deploymentApplicationConfigs": "deployment",
    "worldCount": "worldGeneration",
    "outputLocation": "worldExport",
}


def read_pipeline(path: Path) -> PipelineSpec:
    """Returns the pipeline in a file; paths in it stay as they stand, relative to the file's folder.

    A file may also hold a StartSimulationJobBatch or a CreateSimulationJob request of RoboMaker's, as it stands: a
    pipeline of that batch, or of that job, named like the file. A template in a file is checked with the document, and
    its faults are told with the document's.

    Raises:
        DocumentError: With every fault of the document, of its template, and of the paths that it names.
    """
    return pipeline_of(read_document(path), path, path.parent)


def pipeline_of(data: JsonValue, source: Path, folder: Path) -> PipelineSpec:
    """Returns the pipeline that data is, as for a file.

    Args:
        data: What was read, or what a program made.
        source: Where it comes from, for messages; names the pipeline of a request.
        folder: Where relative paths start.

    Raises:
        DocumentError: As for a file.
    """
    if is_simulation_request(data):
        return pipeline_of_request(data, source)
    _refuse_bare_request(data, source)
    if is_template(data):
        raise DocumentError([_template_alone(source)], str(source))
    beside = [*_template_faults(data, folder), *_missing_sources(data, folder)]
    try:
        spec = parse(PipelineSpec, data, str(source))
    except DocumentError as exc:
        raise DocumentError([*exc.faults, *beside], str(source)) from exc
    if beside:
        raise DocumentError(beside, str(source))
    return spec


def is_template(data: JsonValue) -> bool:
    """Returns whether data is a template, right or wrong, and no pipeline."""
    keys = list(data) if isinstance(data, dict) else []
    if any(key in PipelineSpec.model_fields for key in keys if key != "name"):
        return False
    return any(same_word(key, _TEMPLATE_KEYS) for key in keys)


def is_meant_as_document(data: JsonValue) -> bool:
    """Returns whether data is a document, a template or a request, right or wrong, and nothing else's file."""
    keys = list(data) if isinstance(data, dict) else []
    known = (*(name for name in PipelineSpec.model_fields if name != "name"), *_BARE_REQUESTS)
    return is_template(data) or is_simulation_request(data) or any(same_word(key, known) for key in keys)


def names_a_file(template: str) -> bool:
    """Returns whether a template is named by a path, and not by an ARN, a URL or a name in the store."""
    return not template.startswith(("arn:", "{")) and "://" not in template and ("/" in template or "." in template)


def _template_alone(path: Path) -> Fault:
    allowed = (
        f"a document beside it makes worlds of it, with `name: ...` and `worldGeneration: {{template: {path.name}, "
        f"worldCount: {{floorplanCount: 1}}}}`; `simyard world preview {path}` draws one"
    )
    return Fault(path="document", value="a template alone", allowed=allowed)


def _refuse_bare_request(data: JsonValue, path: Path) -> None:
    """Refuses one of RoboMaker's requests on its own with the one fault that matters: where it belongs.

    Raises:
        DocumentError: It is one.
    """
    section = next((section for key, section in _BARE_REQUESTS.items() if part(data, key) is not None), None)
    if section and part(data, "name") is None:
        allowed = f"`name: ...` at the top, and this request as it stands below `{section}:`"
        raise DocumentError(
            [Fault(path="document", value="a request of RoboMaker's alone", allowed=allowed)], str(path)
        )


def _template_faults(data: JsonValue, folder: Path) -> list[Fault]:
    template = part(part(data, "worldGeneration"), "template")
    if not isinstance(template, str) or not names_a_file(template):
        return []
    try:
        parse(TemplateBody, read_document(folder / template), str(folder / template))
    except DocumentError as exc:
        return [_in_template(fault, template) for fault in exc.faults]
    return []


def _in_template(fault: Fault, template: str) -> Fault:
    place = "" if fault.path in ("file", "document") else f"{fault.path}: "
    return Fault(path="worldGeneration.template", value=f"{template}: {place}{fault.value}", allowed=fault.allowed)


def _missing_sources(data: JsonValue, folder: Path) -> list[Fault]:
    sources = [part(application, "source") for application in items(part(data, "applications"))]
    return [
        Fault(
            path=f"applications[{number}].source",
            value=source,
            allowed=f"a folder; there is none at {folder.absolute() / source}",
        )
        for number, source in enumerate(sources)
        if isinstance(source, str) and not (folder / source).is_dir()
    ]
