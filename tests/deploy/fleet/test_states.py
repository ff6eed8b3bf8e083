import json

import pytest
from pydantic import ValidationError

from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.states import Desired, Reported, progress_of

DESIRED = Desired(
    robot="r1",
    deployment="dep-2",
    sequence=2,
    epoch=1,
    application="courier",
    version=1,
    digest="0" * 64,
    launch=DeploymentLaunchConfig(packageName="courier", launchFile="run.sh"),
    environment={},
    timeout_s=60.0,
    issued_at_s=1000.0,
)
REPORTED = Reported(
    robot="r1", deployment="dep-2", sequence=2, boot_id="b", status="Deploying", step="Launching", started_at_s=1001.0
)
DONE = REPORTED.model_copy(update={"status": "InSync", "step": "Finished", "finished_at_s": 1010.0})


@pytest.mark.parametrize(
    ("reported", "now_s", "status"),
    [
        (None, 1059.0, "PendingNewDeployment"),
        (None, 1061.0, "NoResponse"),
        (REPORTED, 1059.0, "Deploying"),
        (REPORTED, 1061.0, "NoResponse"),
        (DONE, 1059.0, "InSync"),
        (DONE, 9999.0, "InSync"),
        (DONE.model_copy(update={"sequence": 1, "deployment": "dep-1"}), 1059.0, "PendingNewDeployment"),
        (DONE.model_copy(update={"sequence": 1}), 1059.0, "PendingNewDeployment"),
    ],
)
def test_a_robots_status_follows_from_what_was_asked_and_what_it_says(
    reported: Reported | None, now_s: float, status: str
) -> None:
    assert progress_of(DESIRED, reported, now_s=now_s).status == status


def test_a_robot_that_does_not_answer_says_so_with_robomakers_code() -> None:
    progress = progress_of(DESIRED, None, now_s=2000.0)

    assert (progress.failure_code, progress.finished_at_s) == ("RobotDeploymentNoResponse", 2000.0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *[("sequence", value) for value in ("0", "9007199254740993", "9" * 4300, "1e30", "NaN")],
        *[("epoch", value) for value in ("0", "9" * 30)],
        *[("version", value) for value in ("0", "9" * 30)],
        *[
            (field, value)
            for field in ("timeout_s", "issued_at_s", "expires_at_s")
            for value in ("-1", "1e12", "Infinity", "NaN")
        ],
        ("deployment", '"a\\nb"'),
        ("robot", '""'),
        ("application", '"' + "x" * 300 + '"'),
    ],
)
def test_a_desired_state_with_a_value_that_nobody_writes_is_none(field: str, value: str) -> None:
    document = json.loads(DESIRED.model_dump_json())
    document[field] = "HERE"

    with pytest.raises(ValidationError, match=field):
        Desired.model_validate_json(json.dumps(document).replace('"HERE"', value))
