"""Reads a pipeline document together with the files beside it that it names.

RoboMaker's own requests are documents, too: what `aws robomaker ... --cli-input-json` was given runs as it stands.
"""

import copy
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.section_requests import undriven_faults
from specs.rules import items, part
from specs.template.body import TemplateBody
from tasks.documents.parse import parse
from tasks.documents.shape_text import same_word
from tasks.documents.source_text import read_document

_BATCH_KEY, _JOB_KEY = "createSimulationJobRequests", "maxJobDurationInSeconds"
# What a CreateSimulationJob has of its own stands in a batch's own fields; the rest is its only entry's.
_OF_THE_BATCH = ("clientRequestToken",)
_SECTION = "simulationBatch."
_ONLY_ENTRY = f"{_SECTION}{_BATCH_KEY}[0]."
_ANY_ENTRY = f"{_SECTION}{_BATCH_KEY}[*]."
_NOT_IN_A_NAME = re.compile("[^a-zA-Z0-9_-]+")
_LONGEST_NAME = 64
_STEP = re.compile(r"[^.\[\]]+")
_TEMPLATE_KEYS = ("templateBody", "Version", "Buildings", "Floors", "Floorplan", "Interior", "Rooms")
_BARE_REQUESTS = {
    "deploymentApplicationConfigs": "deployment",
    "worldCount": "worldGeneration",
    "outputLocation": "worldExport",
}


def is_simulation_request(data: JsonValue) -> bool:
    """Returns whether data is a StartSimulationJobBatch or CreateSimulationJob request and no pipeline."""
    return part(data, "name") is None and any(part(data, key) is not None for key in (_BATCH_KEY, _JOB_KEY))


def pipeline_of_request(data: JsonValue, path: Path) -> PipelineSpec:
    """Returns the pipeline that a request stands for: one batch, or one job.

    Args:
        data: The request (`is_simulation_request`).
        path: Its file, which gives the pipeline its name.

    Raises:
        DocumentError: With every fault, each where it stands in the request.
    """
    request = cast("Mapping[str, JsonValue]", data)
    section = request if _BATCH_KEY in request else _single(request)
    document: JsonValue = {"name": _name(path), "simulationBatch": dict(section)}
    try:
        return parse(PipelineSpec, document, str(path))
    except DocumentError as exc:
        raise DocumentError([in_request(fault, request) for fault in exc.faults], str(path)) from exc


def in_request(fault: Fault, request: Mapping[str, JsonValue]) -> Fault:
    """Returns a fault of the pipeline that a request stands for, as one of the request."""
    if fault.path == "simulationBatch.matrix.worlds":
        allowed = "simulationApplications[0].worldConfigs in every request: the world that it runs in, by ARN"
        return Fault(path="document", value="a job without a world", allowed=allowed)
    prefixes = (_SECTION,) if _BATCH_KEY in request else (_ONLY_ENTRY, _ANY_ENTRY, _SECTION)
    path = fault.path
    for prefix in prefixes:
        path = path.removeprefix(prefix)
    return fault.model_copy(update={"path": path})


def _single(request: Mapping[str, JsonValue]) -> Mapping[str, JsonValue]:
    own: dict[str, Any] = {key: request[key] for key in _OF_THE_BATCH if key in request}
    entry = {key: value for key, value in request.items() if key not in own}
    return {**own, "operation": "CreateSimulationJob", _BATCH_KEY: [entry]}


def _name(path: Path) -> str:
    name = _NOT_IN_A_NAME.sub("-", path.stem).strip("-_")[:_LONGEST_NAME]
    return name or "request"


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
        known = tuple(fault.path for fault in exc.faults)
        undriven = undriven_faults(part(data, "simulationBatch"))
        more = [fault for fault in undriven if not fault.path.startswith(known)]
        raise DocumentError([*exc.faults, *more, *beside], str(source)) from exc
    if beside:
        raise DocumentError(beside, str(source))
    return spec


def without(data: JsonValue, paths: Iterable[str]) -> JsonValue:
    """Returns a document without the keys at some places, as faults name them; items of lists stay where they are."""
    trimmed = copy.deepcopy(data)
    for *above, key in filter(None, map(_STEP.findall, paths)):
        inside: JsonValue = trimmed
        for step in above:
            found = items(inside)[int(step) : int(step) + 1] if step.isdigit() else [part(inside, step)]
            inside = cast("JsonValue", found[0] if found else None)
        if isinstance(inside, dict):
            inside.pop(key, None)
    return trimmed


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
        raise DocumentError.of("document", "a request of RoboMaker's alone", allowed, source=str(path))


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
            allowed=f"a folder, or a container image; there is none at {folder.absolute() / source}",
        )
        for number, source in enumerate(sources)
        if isinstance(source, str) and "://" not in source and not (folder / source).exists()
    ]
