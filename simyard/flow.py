"""Simyard's flows, for the entrypoints of Prefect deployments, such as `simyard.flow.pipeline`; and their results.

A worker starts in the folder of its deployment, where a `flows` of the user's would come first. `flows.prefect.flows`
is not found then, and this module says why.
"""

from flows.prefect.flow_calls import result_of
from flows.prefect.flows import deployment_sync, pipeline, reaping, simulation_batch, world_export, world_generation

__all__ = [
    "deployment_sync",
    "pipeline",
    "reaping",
    "result_of",
    "simulation_batch",
    "world_export",
    "world_generation",
]
