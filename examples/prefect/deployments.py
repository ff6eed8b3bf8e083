"""Deployments from Python, beside those of prefect.yaml: served by this process, or made for the workers of a pool.

python examples/prefect/deployments.py serve        (this process works on the runs, also on a schedule, until Ctrl-C)
python examples/prefect/deployments.py deploy       (a worker of the pool does; the pool must exist)
"""

import sys
from pathlib import Path

from prefect import flow
from prefect.schedules import Cron

from flows.prefect.flows import world_generation

ROOT = Path(__file__).resolve().parents[2]
PARAMETERS = {
    "spec": {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 9},
    "base": str(ROOT / "examples"),
}
EVERY_NIGHT = Cron("0 2 * * *", timezone="Europe/Berlin")


def serve() -> None:
    """Works on runs of `world-generation/served` until it is interrupted."""
    world_generation.serve(name="served", parameters=PARAMETERS, schedules=[EVERY_NIGHT])


def deploy() -> None:
    """Makes `world-generation/from-source`: a worker loads the flow from a clone, here the one that this file is in."""
    found = flow.from_source(source=str(ROOT), entrypoint="flows/prefect/flows.py:world_generation")
    found.deploy(name="from-source", work_pool_name="local", parameters=PARAMETERS, schedules=[EVERY_NIGHT])


if __name__ == "__main__":
    {"serve": serve, "deploy": deploy}[sys.argv[1]]()
