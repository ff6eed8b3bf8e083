"""docs/guide/prefect.md: each way of calling a flow, on a real server with a worker, ends with the job's ARN."""

import json
import re
import shlex
from importlib.util import find_spec

import pytest

from tests.integration.prefect_features.team import Team
from tests.repository import ROOT
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration
WORLDS = re.compile(r"^arn:simyard:world-generation-job:\S+$", re.MULTILINE)
PARAMETERS = {
    "spec": {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 41},
    "base": "examples",
}
(TYPED,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/guide/prefect.md").read_text(), re.DOTALL)
COMMAND = shlex.split(TYPED)  # prefect deployment run world-generation/on-demand, and its parameters
(READ,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/guide/prefect.md").read_text(), re.DOTALL)
COUNT = """
from prefect.client.orchestration import get_client
print(len(get_client(sync_client=True).read_flow_runs()))
"""


@pytest.mark.long
@pytest.mark.usefixtures("team_worker")
@pytest.mark.parametrize(
    ("example", "arguments"),
    [
        ("deployment_runs", ()),
        pytest.param("async_flow", (), marks=pytest.mark.soak),
        pytest.param("mapped_seeds", ("threads",), marks=pytest.mark.soak),
        pytest.param("mapped_seeds", ("processes",), marks=pytest.mark.soak),
        pytest.param("mapped_seeds", ("dask",), marks=pytest.mark.soak),
        pytest.param(
            "mapped_seeds",
            ("ray",),
            marks=[pytest.mark.soak, pytest.mark.skipif(not find_spec("ray"), reason="simyard[ray] is not installed")],
        ),
    ],
)
def test_an_own_flow_gets_the_arns_of_two_jobs(team: Team, example: str, arguments: tuple[str, ...]) -> None:
    told = team.run("python", f"examples/prefect/{example}.py", *arguments)

    assert len(set(WORLDS.findall(told))) == 2


@pytest.mark.soak
def test_sub_flows_hand_on_worlds_to_a_batch_and_a_roll_out(team: Team) -> None:
    told = team.run("python", "examples/prefect/sub_flows.py")

    kinds = re.findall(r"^arn:simyard:([\w-]+):", told, re.MULTILINE)
    assert kinds == ["world-generation-job", "simulation-job-batch", "deployment-job"]
    assert "1 of 1 robots runs courier 1: arn:simyard:deployment-job:" in told.replace("\n", "")


@pytest.mark.soak
@pytest.mark.usefixtures("team_worker")
def test_a_deployment_of_the_own_program_returns_the_job(team: Team) -> None:
    team.run("python", "examples/prefect/deployments.py", "deploy")
    with team.started("python", "examples/prefect/deployments.py", "serve") as log:
        eventually(lambda: "is being served" in log.read_text())
        for name in ("served", "from-source"):
            assert _run(team, name)[1].startswith("arn:simyard:world-generation-job:")


@pytest.mark.long
@pytest.mark.usefixtures("team_worker")
def test_a_run_from_the_command_line_says_what_came_of_it(team: Team) -> None:
    message, record = _run(team, "on-demand", *COMMAND[4:])

    assert record.startswith("arn:simyard:world-generation-job:")
    assert message == f"1 world: {record}"


@pytest.mark.long
def test_the_server_keeps_no_run_of_a_store_with_a_secret_and_does_not_repeat_it(team: Team) -> None:
    parameters = json.dumps({**PARAMETERS, "store": "s3://key:hunter2@bucket/x"})
    before = team.run("python", "-c", COUNT)

    told = team.run("prefect", "deployment", "run", "world-generation/on-demand", "--params", parameters, check=False)

    assert "Validation failed for field 'store'" in told
    assert "hunter2" not in told
    assert team.run("python", "-c", COUNT) == before


def _run(team: Team, name: str, *arguments: str) -> list[str]:
    """Returns what another process reads of a run of a deployment: its message, and its result."""
    told = team.run("prefect", "deployment", "run", f"world-generation/{name}", "--watch", *arguments)
    found = re.search(r"UUID: ([0-9a-f-]{36})", told)
    assert found, told
    return team.run("python", "-c", READ, found[1]).splitlines()[-2:]
