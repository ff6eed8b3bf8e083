"""Simyard's flows, for the entrypoints of Prefect deployments, such as `simyard.flow.pipeline`.

A worker starts in the folder of its deployment, where a `flows` of the user's would come first. `flows.prefect.flows`
is not found then, and this module says why.
"""

from flows.prefect.flows import deployment_sync, pipeline, reaping, simulation_batch, world_export, world_generation

__all__ = ["deployment_sync", "pipeline", "reaping", "simulation_batch", "world_export", "world_generation"]
