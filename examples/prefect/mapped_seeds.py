"""A flow of Simyard's for each of many seeds, by `.map`, in threads, in processes, or on the workers of Dask or Ray.

Only a task has `.map`. So the task calls the flow, and returns what is small: the ARN.

python examples/prefect/mapped_seeds.py threads     (or processes, dask, ray)
"""

import sys
from pathlib import Path

from prefect import flow, task
from prefect.task_runners import ProcessPoolTaskRunner, TaskRunner, ThreadPoolTaskRunner

from flows.prefect.flows import world_generation
from specs.pipeline.world_sections import WorldGeneration

EXAMPLES = Path(__file__).resolve().parents[1]
WORLDS = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}}


# A process gives its result back through the storage of results.
@task(task_run_name="worlds of seed {seed}", persist_result=True)
def worlds_of_seed(seed: int) -> str:
    """Returns the ARN of the generation job of one seed."""
    return world_generation(WorldGeneration.model_validate({**WORLDS, "seed": seed}), base=str(EXAMPLES)).arn


@flow
def worlds_of_seeds(seeds: list[int]) -> list[str]:
    """Returns the ARNs of the generation jobs of all seeds."""
    arns = worlds_of_seed.map(seeds).result()
    print(*arns, sep="\n")
    return arns


def runner(name: str) -> TaskRunner:
    """Returns who runs the tasks; Dask and Ray are the extras `simyard[dask]` and `simyard[ray]`."""
    if name == "dask":
        from prefect_dask import DaskTaskRunner  # noqa: PLC0415 - not installed everywhere

        return DaskTaskRunner(cluster_kwargs={"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None})
    if name == "ray":
        from prefect_ray import RayTaskRunner  # noqa: PLC0415 - same

        return RayTaskRunner(init_kwargs={"num_cpus": 2, "include_dashboard": False})
    return ProcessPoolTaskRunner(max_workers=2) if name == "processes" else ThreadPoolTaskRunner(max_workers=2)


if __name__ == "__main__":
    worlds_of_seeds.with_options(task_runner=runner(sys.argv[1]))([11, 12])
