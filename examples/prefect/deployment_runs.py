"""An own flow that starts runs of Simyard's deployments, which a worker works on, and takes their results.

python examples/prefect/deployment_runs.py          (after `prefect deploy --all`, with a worker)
"""

from prefect import flow
from prefect.deployments import run_deployment

from simyard.flow import result_of

DEPLOYMENT = "world-generation/on-demand"
WORLDS = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 6}


@flow
def worlds_by_deployment() -> list[str]:
    """Returns the ARNs of two generation jobs: of a sub-flow's, and of a run that stands alone in Prefect's pages."""
    parameters = {"spec": WORLDS, "base": "examples"}
    nested = run_deployment(DEPLOYMENT, parameters=parameters)
    alone = run_deployment(DEPLOYMENT, parameters=parameters, as_subflow=False)
    arns = [result_of(run.state).arn for run in (nested, alone)]
    print(*arns, sep="\n")
    return arns


if __name__ == "__main__":
    worlds_by_deployment()
