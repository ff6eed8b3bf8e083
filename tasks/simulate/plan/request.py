"""The request in a batch's record, of a batch or of a single job.

See docs/reference/robomaker.md, sections 3 and 4.
"""

from collections.abc import Mapping
from typing import cast

from pydantic import JsonValue

from specs.field_types import OutputLocation, TagMap
from specs.robomaker.simulation import BatchPolicy, CreateSimulationJobRequest, StartSimulationJobBatchRequest
from tasks.simulate.plan.resolve import DEFAULT_OUTPUT
from tasks.storage.jobs.records import JobRecord

Document = dict[str, JsonValue]
_ENTRIES = "createSimulationJobRequests"


def entries(record: JobRecord) -> list[Document]:
    """Returns the entries of a batch's request; a CreateSimulationJob is its own only entry."""
    request = _request(record)
    return cast("list[Document]", request[_ENTRIES]) if _ENTRIES in request else [dict(request)]


def is_single(record: JobRecord) -> bool:
    """Returns whether CreateSimulationJob made it, so that its only job is no batch's entry."""
    return _ENTRIES not in _request(record)


def policy_and_tags(record: JobRecord) -> tuple[BatchPolicy | None, TagMap | None]:
    """Returns a batch's policy and its own tags; a single job has neither, its tags are the job's."""
    if is_single(record):
        return None, None
    request = StartSimulationJobBatchRequest.model_validate(_request(record))
    return request.batchPolicy, request.tags


def recorded_location(record: JobRecord) -> OutputLocation:
    """Returns where the batch's tables go: its entries have the place, and agree on it."""
    if is_single(record):
        return CreateSimulationJobRequest.model_validate(_request(record)).outputLocation or DEFAULT_OUTPUT
    request = StartSimulationJobBatchRequest.model_validate(_request(record))
    places = (entry.outputLocation for entry in request.createSimulationJobRequests if entry.outputLocation)
    return next(places, DEFAULT_OUTPUT)


def _request(record: JobRecord) -> Mapping[str, JsonValue]:
    return cast("Mapping[str, JsonValue]", record.request["request"])
