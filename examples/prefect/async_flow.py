"""An own async flow. Simyard's flows are sync functions: called at once they would block the event loop.

So a thread calls one, and is awaited; or a deployment's run is awaited, which a worker works on.

python examples/prefect/async_flow.py               (after `prefect deploy --all`, with a worker)
"""

import asyncio
from pathlib import Path

from prefect import flow
from prefect.deployments import arun_deployment

from flows.prefect.flows import world_generation
from simyard.flow import result_of
from specs.pipeline.world_sections import WorldGeneration

EXAMPLES = Path(__file__).resolve().parents[1]
WORLDS = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 7}


@flow
async def worlds_beside_each_other() -> list[str]:
    """Returns the ARNs of two generation jobs that were worked on at the same time."""
    section = WorldGeneration.model_validate(WORLDS)
    here, run = await asyncio.gather(
        asyncio.to_thread(world_generation, section, base=str(EXAMPLES)),
        arun_deployment("world-generation/on-demand", parameters={"spec": {**WORLDS, "seed": 8}, "base": "examples"}),
    )
    there = await asyncio.to_thread(result_of, run.state)
    print(here.arn, there.arn, sep="\n")
    return [here.arn, there.arn]


if __name__ == "__main__":
    asyncio.run(worlds_beside_each_other())
