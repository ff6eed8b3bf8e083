"""Batches and simulation jobs in RoboMaker's words.

A job is `<batch>/<index>`; nothing is stored for it alone. What was asked of it follows from the batch's plan, and what
came of it stands in its chunk.
"""

import itertools
from typing import cast

from pydantic import JsonValue

from specs.arn import arn
from specs.base import Fault
from specs.episode import EpisodeRequest, EpisodeResult
from specs.errors import ResourceNotFound
from specs.simulation_batch import StartSimulationJobBatchRequest
from specs.simulation_descriptions import (
    DescribeSimulationJobBatchResponse,
    DescribeSimulationJobResponse,
    SimulationJobBatchSummary,
    SimulationJobSummary,
)
from tasks.simulate.batch import KIND, chunks_of, committed_chunk, committed_results, plan_of
from tasks.simulate.batch_plan import BatchPlan, episode_count, episodes
from tasks.storage.opening import store_id
from tasks.storage.records import JobRecord, is_terminal, read, records
from tasks.storage.store import Store


def describe_batch(store: Store, batch: str) -> DescribeSimulationJobBatchResponse:
    """Returns a batch with a summary of each of its jobs.

    Raises:
        ResourceNotFound: No such batch.
    """
    record = read(store, KIND, batch)
    request = StartSimulationJobBatchRequest.model_validate(record.request["request"])
    return DescribeSimulationJobBatchResponse(
        arn=record.arn,
        status=record.status,  # pyright: ignore[reportArgumentType] - checked by pydantic
        createdAt=record.created_at_s,
        lastUpdatedAt=record.updated_at_s,
        clientRequestToken=record.token,
        failureCode=record.failure_code or None,  # pyright: ignore[reportArgumentType] - as above
        failureReason=record.failure_reason or None,
        batchPolicy=request.batchPolicy,
        createdRequests=tuple(_summaries(store, record)),
        tags=request.tags,
    )


def list_batches(store: Store) -> list[SimulationJobBatchSummary]:
    """Returns all batches, oldest first."""
    return [
        SimulationJobBatchSummary(
            arn=record.arn,
            createdAt=record.created_at_s,
            lastUpdatedAt=record.updated_at_s,
            status=record.status,  # pyright: ignore[reportArgumentType] - as above
            createdRequestCount=episode_count(plan_of(record)),
            failedRequestCount=0,
            pendingRequestCount=0,
        )
        for record in records(store, KIND)
    ]


def list_jobs(store: Store) -> list[SimulationJobSummary]:
    """Returns the jobs of all batches, by batch and index."""
    return [summary for record in records(store, KIND) for summary in _summaries(store, record)]


def describe_job(store: Store, path: str) -> DescribeSimulationJobResponse:
    """Returns one job of a batch.

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such batch, or it has no such job.
    """
    batch, _, number = path.partition("/")
    record = read(store, KIND, batch)
    plan = plan_of(record)
    index = int(number) if number.isdecimal() else -1
    if not 0 <= index < episode_count(plan):
        allowed = f"{batch}/0 to {batch}/{episode_count(plan) - 1}"
        raise ResourceNotFound([Fault(path="simulation-job", value=repr(path), allowed=allowed)])
    request = next(itertools.islice(episodes(plan), index, None))
    return DescribeSimulationJobResponse.model_validate(
        {
            **_asked(record, plan, request),
            **_state(record, _result(store, record, plan, index)),
            "arn": _arn(store, record, index),
            "lastUpdatedAt": record.updated_at_s,
        }
    )


def _summaries(store: Store, record: JobRecord) -> list[SimulationJobSummary]:
    plan = plan_of(record)
    results = {result.index: result for result in committed_results(store, record)}
    identifier = store_id(store)
    return [
        SimulationJobSummary.model_validate(
            {
                "arn": arn("simulation-job", identifier, f"{record.id}/{request.index}"),
                "lastUpdatedAt": record.updated_at_s,
                "name": f"{record.id}-{request.index}",
                "status": _state(record, results.get(request.index))["status"],
                "robotApplicationNames": (request.robot.name,),
                "simulationApplicationNames": (request.scenario.name,),
            }
        )
        for request in episodes(plan)
    ]


def _result(store: Store, record: JobRecord, plan: BatchPlan, index: int) -> EpisodeResult | None:
    for chunk in chunks_of(plan):
        if any(request.index == index for request in chunk.requests):
            results = committed_chunk(store, record.id, chunk.number) or []
            return next((result for result in results if result.index == index), None)
    return None


def _state(record: JobRecord, result: EpisodeResult | None) -> dict[str, JsonValue]:
    if result is None:
        return {"status": "Canceled" if is_terminal(record) else "Pending"}
    state: dict[str, JsonValue] = {"status": result.status, "simulationTimeMillis": round(1000 * result.simulated_s)}
    if result.failure_code:
        state |= {"failureCode": result.failure_code, "failureReason": result.failure_reason}
    return state


def _asked(record: JobRecord, plan: BatchPlan, request: EpisodeRequest) -> dict[str, JsonValue]:
    """Returns the entry of the batch that the job came from, with its own world and variables."""
    document = cast("dict[str, list[dict[str, JsonValue]]]", record.request["request"])
    entry = dict(document["createSimulationJobRequests"][_template_number(plan, request.index)])
    for kind, resolved in (("robotApplications", request.robot), ("simulationApplications", request.scenario)):
        (use,) = cast("list[dict[str, JsonValue]]", entry[kind])
        launch: dict[str, JsonValue] = {
            **cast("dict[str, JsonValue]", use["launchConfig"]),
            "environmentVariables": {**request.environment},
        }
        entry[kind] = [{**use, "applicationVersion": resolved.version, "launchConfig": launch}]
    (scenario,) = cast("list[dict[str, JsonValue]]", entry["simulationApplications"])
    world = arn("world", record.arn.split(":")[3], request.world)
    entry["simulationApplications"] = [{**scenario, "worldConfigs": [{"world": world}]}]
    # Kept in the request for old documents; RoboMaker's answer has no place for them.
    return {key: value for key, value in entry.items() if key in DescribeSimulationJobResponse.model_fields}


def _template_number(plan: BatchPlan, index: int) -> int:
    settings = episode_count(plan) // sum(len(template.worlds) for template in plan.templates)
    for number, template in enumerate(plan.templates):
        index -= len(template.worlds) * settings
        if index < 0:
            return number
    raise IndexError(index)


def _arn(store: Store, record: JobRecord, index: int) -> str:
    return arn("simulation-job", store_id(store), f"{record.id}/{index}")
