"""The parameter `spec` of a flow: a document or a section of one, or the file that holds the document.

A file is read when a run begins, and its content decides which run that is, as for `simyard run`: a deployment that
names one runs what stands there tonight. Prefect keeps the file's name, and the form in the browser offers both.
"""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, cast, get_args, get_type_hints

from pydantic import Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from specs.base import Fault, Spec
from specs.errors import DocumentError
from specs.field_types import Path as SourcePath
from specs.pipeline.document import PipelineSpec
from specs.pipeline.simulation_section import Deployment, SimulationBatch
from specs.pipeline.world_sections import WorldExport, WorldGeneration
from tasks.documents.parse import parse
from tasks.documents.pipeline_file import is_meant_as_document, pipeline_of
from tasks.documents.source_text import read_document

_SPEC, _BASE, _FILE = "spec", "base", "document"
# Not by "required": Prefect's server leaves that out where it checks the parameters of a deployment, to which a run may
# add others.
_NAMES_A_FILE = {"not": {"properties": {_FILE: {"not": {}}}}}


class DocumentFile(Spec):
    """A document in a file, of the machine that runs it."""

    document: SourcePath = Field(title="File", description="Its path, from the base or the worker's working directory.")


class _OrFile:
    """Says that a parameter may name a document's file, and what it takes of the document.

    Args:
        section: The section; empty for the whole document.
    """

    def __init__(self, section: str = "") -> None:
        self.section = section

    def __get_pydantic_json_schema__(self, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Returns the schema with both: the form has one field more, and the server tells what is wrong with which."""
        given, file = handler(core_schema), DocumentFile.model_json_schema()
        fields = {**file["properties"], **handler.resolve_ref_schema(given)["properties"]}
        shown = {name: {**below, "position": position} for position, (name, below) in enumerate(fields.items())}
        return {"type": "object", "properties": shown, "if": _NAMES_A_FILE, "then": file, "else": given}


DocumentParameter = Annotated[PipelineSpec, _OrFile()]
"""A document, or ``{document: path}``."""
WorldGenerationParameter = Annotated[WorldGeneration, _OrFile("worldGeneration")]
"""A document's section ``worldGeneration``, or ``{document: path}``; those below likewise."""
WorldExportParameter = Annotated[WorldExport, _OrFile("worldExport")]
SimulationBatchParameter = Annotated[SimulationBatch, _OrFile("simulationBatch")]
DeploymentParameter = Annotated[Deployment, _OrFile("deployment")]


def with_document(function: Callable[..., object], parameters: dict[str, Any]) -> dict[str, Any]:
    """Returns a flow's parameters with what stands in the file that they name, if they name one.

    The base becomes the file's folder, from which the paths in a document start.

    Args:
        function: The flow's.
        parameters: As they were given.

    Raises:
        DocumentError: There is no such file, or what it holds is wrong; with all its faults.
    """
    given, form = parameters.get(_SPEC), _form(function)
    if form is None or not isinstance(given, Mapping) or _FILE not in given:
        return parameters
    named = parse(DocumentFile, cast("Any", dict(cast("Mapping[str, object]", given))), _SPEC).document
    path = Path(parameters.get(_BASE) or ".") / named
    if not path.is_file():
        allowed = f"a document on this machine; {path.resolve()} is no file"
        raise DocumentError([Fault(path=f"{_SPEC}.{_FILE}", value=repr(named), allowed=allowed)], "parameters")
    found = _part(_document(path), form.section, path)
    base = {_BASE: str(path.parent)} if _BASE in inspect.signature(function).parameters else {}
    return {**parameters, **base, _SPEC: found}


def _document(path: Path) -> PipelineSpec:
    """Returns the document in a file.

    Faults are kept with the run, where who may not read the worker's files sees them: so nothing of what a file of
    another kind holds, such as a password, is told.

    Raises:
        DocumentError: It holds none, or one with faults.
    """
    data = read_document(path)
    if not is_meant_as_document(data):
        sections = ", ".join(name for name in PipelineSpec.model_fields if name != "name")
        fault = Fault(
            path=_FILE, value="no document of Simyard's", allowed=f"a file with some of {sections} at its top"
        )
        raise DocumentError([fault], str(path))
    return pipeline_of(data, path, path.parent)


def _form(function: Callable[..., object]) -> _OrFile | None:
    hint = get_type_hints(function, include_extras=True).get(_SPEC)
    return next((each for each in get_args(hint)[1:] if isinstance(each, _OrFile)), None)


def _part(spec: PipelineSpec, section: str, path: Path) -> object:
    found = getattr(spec, section) if section else spec
    if found is None:
        raise DocumentError(
            [Fault(path=section, value="missing", allowed="a section, which this flow runs")], str(path)
        )
    return found
