"""What an application is told of the job that it is in."""

import re

from specs.arn import ArnForm
from tasks.simulate.plan.chunks import JOB_ARN, JOB_ID, RUN_ID, job_variables, program_key, without_job_variables
from tests.factories.simulations import delivery

FORM = ArnForm("0123456789ab", "us-west-2")
BATCH = "simb-0123456789abcdef"


def test_a_jobs_id_is_what_its_arn_ends_in():
    told = job_variables(FORM, BATCH, 12)
    assert told[JOB_ID] == "sim-0123456789abcdef12"
    assert told[JOB_ARN] == f"arn:aws:robomaker:us-west-2:{FORM.account}:simulation-job/sim-0123456789abcdef12"
    assert re.fullmatch("run-[0-9a-f]{16}", told[RUN_ID])


def test_each_job_has_its_own_and_always_the_same():
    told = [job_variables(FORM, BATCH, index) for index in (0, 1, 0)]
    assert told[0] == told[2]
    assert not set(told[0].values()) & set(told[1].values())


def test_what_tells_jobs_apart_decides_no_program():
    asked = delivery(0, world="g/w")
    own = asked.model_copy(update={"environment": {**asked.environment, **job_variables(FORM, BATCH, 0)}})
    assert program_key(own) == program_key(asked)
    assert without_job_variables(own.environment) == asked.environment
