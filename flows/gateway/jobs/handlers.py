"""The table of the calls about jobs, joined from their families."""

from flows.gateway.gateway import Handlers
from flows.gateway.jobs import deployment, simulation, simulation_batch, world_export, world_generation

HANDLERS: Handlers = {
    **deployment.HANDLERS,
    **simulation.HANDLERS,
    **simulation_batch.HANDLERS,
    **world_export.HANDLERS,
    **world_generation.HANDLERS,
}
