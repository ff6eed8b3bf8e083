"""The variables that RoboMaker set in each job: which job it is (docs/reference/robomaker.md, section 9).

They follow from the batch and the episode's place in it, so that a chunk that is simulated again, a replay and an audit
see the same ones. They are no part of a plan, and decide no program: the lanes of a program are different jobs.
"""

import hashlib
from collections.abc import Mapping

from specs.arn import ArnForm, arn

JOB_ID = "AWS_ROBOMAKER_SIMULATION_JOB_ID"
JOB_ARN = "AWS_ROBOMAKER_SIMULATION_JOB_ARN"
RUN_ID = "AWS_ROBOMAKER_SIMULATION_RUN_ID"
_NAMES = frozenset({JOB_ID, JOB_ARN, RUN_ID})


def job_variables(form: ArnForm, batch: str, index: int) -> dict[str, str]:
    """Returns the variables of one job.

    Args:
        form: Of the ARNs that clients see.
        batch: Its batch's id.
        index: Its episode's.
    """
    path = f"{batch}/{index}"
    own = form.robomakers(arn("simulation-job", form.store_id, path))
    run = hashlib.sha256(path.encode()).hexdigest()[:16]
    return {JOB_ID: own.rpartition("/")[2], JOB_ARN: own, RUN_ID: f"run-{run}"}


def without_job_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns an environment without what tells one job from another."""
    return {name: value for name, value in environment.items() if name not in _NAMES}
