"""RoboMaker's own requests as documents: what `aws robomaker ... --cli-input-json` was given runs as it stands."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.rules import part
from tasks.documents.parse import parse

_BATCH_KEY, _JOB_KEY = "createSimulationJobRequests", "maxJobDurationInSeconds"
# What a CreateSimulationJob has of its own stands in a batch's own fields; the rest is its only entry's.
_OF_THE_BATCH = ("clientRequestToken",)
_SECTION = "simulationBatch."
_ONLY_ENTRY = f"{_SECTION}{_BATCH_KEY}[0]."
_ANY_ENTRY = f"{_SECTION}{_BATCH_KEY}[*]."
_NOT_IN_A_NAME = re.compile("[^a-zA-Z0-9_-]+")
_LONGEST_NAME = 64


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
