"""An own flow that calls Simyard's flows as sub-flows: worlds, a batch in them, and the roll-out of what passed.

python examples/prefect/sub_flows.py
"""

from pathlib import Path

from prefect import flow

from flows.prefect.flows import deployment_sync, simulation_batch, world_generation
from specs.pipeline.simulation_section import Deployment, SimulationBatch
from specs.pipeline.world_sections import WorldGeneration

EXAMPLES = Path(__file__).resolve().parents[1]
WORLDS = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 5}
BATCH = {
    "matrix": {"worlds": "all", "seeds": 4},
    "outputLocation": {"s3Bucket": "results"},
    "audit": {"lanes": 0},
    "createSimulationJobRequests": [
        {
            "maxJobDurationInSeconds": 60,
            "robotApplications": [
                {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "go_to_goal"}}
            ],
            "simulationApplications": [
                {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
            ],
        }
    ],
}
ROLL_OUT = {
    "fleet": {"name": "demonstration", "localAgents": 1},
    "deploymentApplicationConfigs": [
        {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "run.sh"}}
    ],
}


@flow
def night() -> str:
    """Returns the ARN of the roll-out; each sub-flow returns its job, as a plain function would."""
    worlds = world_generation(WorldGeneration.model_validate(WORLDS), base=str(EXAMPLES))
    batch = simulation_batch(SimulationBatch.model_validate(BATCH), worlds=worlds.detail["worlds"])
    if batch.detail["passed"] != batch.detail["episodes"]:
        raise ValueError(f"{batch.arn}: not every episode passed")
    rolled_out = deployment_sync(Deployment.model_validate(ROLL_OUT))
    print(worlds.arn, batch.arn, rolled_out.arn, rolled_out.status, sep="\n")
    return rolled_out.arn


if __name__ == "__main__":
    night()
