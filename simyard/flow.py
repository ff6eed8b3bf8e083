"""Simyard's flows, for the entrypoints of Prefect deployments, such as `simyard.flow.pipeline`.

A worker starts in the folder of its deployment, where a `flows` of the user's would come first: `flows.pipeline` is not
found then, and this module says why.
"""

from flows.deployment_sync import deployment_sync
from flows.pipeline import pipeline
from flows.reaping import reaping
from flows.simulation_batch import simulation_batch
from flows.world_export import world_export
from flows.world_generation import world_generation

__all__ = ["deployment_sync", "pipeline", "reaping", "simulation_batch", "world_export", "world_generation"]
