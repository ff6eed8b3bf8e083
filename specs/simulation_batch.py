"""Simulation job batches: RoboMaker's requests."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.common import Arn, ClientRequestToken, FilteredPage, Integer, TagMap
from specs.rules import Within
from specs.simulation import SimulationJobRequest

MAX_BATCH_TIMEOUT_S = 1_209_600
MAX_REQUESTS = 1000

SimulationJobBatchStatus = Literal[
    "Pending", "InProgress", "Failed", "Completed", "Canceled", "Canceling", "Completing", "TimingOut", "TimedOut"
]
SimulationJobBatchErrorCode = Literal["InternalServiceError"]
CreateSimulationJobRequests = Annotated[tuple[SimulationJobRequest, ...], Field(min_length=1, max_length=MAX_REQUESTS)]


class BatchPolicy(Spec):
    """How long a batch may take and how many of its jobs may be active at once."""

    timeoutInSeconds: Annotated[Integer, Within(1, MAX_BATCH_TIMEOUT_S, "seconds")] | None = Field(
        default=None, title="Timeout (s)", description="Wall-clock seconds for the whole batch."
    )
    maxConcurrency: Annotated[Integer, Within(1, 1_000_000, "jobs")] | None = Field(
        default=None, title="Concurrency", description="Jobs that are simulated side by side."
    )


class StartSimulationJobBatchRequest(Spec):
    """Asks for many simulation jobs."""

    clientRequestToken: ClientRequestToken | None = None
    batchPolicy: BatchPolicy | None = None
    createSimulationJobRequests: CreateSimulationJobRequests
    tags: TagMap | None = None


class DescribeSimulationJobBatchRequest(Spec):
    """Asks about a batch."""

    batch: Arn


class CancelSimulationJobBatchRequest(Spec):
    """Asks that a batch be stopped."""

    batch: Arn


class CancelSimulationJobBatchResponse(Spec):
    """Says nothing."""


class ListSimulationJobBatchesRequest(FilteredPage):
    """Asks for the batches."""
