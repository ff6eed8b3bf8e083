"""docs/operate/operations.md: results in a bucket, and a store whose credentials only a block has."""

import re

import pytest

from tests.repository import ROOT
from tests.servers.prefect_team import Team
from tests.servers.seaweed import Seaweed

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]
DOCUMENT = (ROOT / "docs/operate/operations.md").read_text()
(MAKE_RESULTS,) = [
    block for block in re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL) if "RemoteFileSystem" in block
]
RESULTS = "remote-file-system/simyard-results"
CALL = """
import sys
from flows.world_generation import world_generation
spec = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 51}
state = world_generation(spec, store=sys.argv[1] or None, base="examples", return_state=True)
print(state.state_details.flow_run_id, state.result().arn, state.data.metadata.storage_key)
"""
READ = """
import sys
from prefect.client.orchestration import get_client
state = get_client(sync_client=True).read_flow_run(sys.argv[1]).state
print(state.message)
print(state.result(retry_result_failure=False).arn)
"""


def test_another_machine_reads_a_result_from_the_bucket(team: Team, seaweed: Seaweed) -> None:
    seaweed.make_bucket("simyard-results")
    environment = {**seaweed.environment(), "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK": RESULTS}
    team.run("python", "-c", MAKE_RESULTS)

    run, arn, key = team.run("python", "-c", CALL, "", **environment).split()[-3:]
    other = {**seaweed.environment(), "PREFECT_HOME": str(team.folder / "other machine")}
    read = team.run("python", "-c", READ, run, **other).splitlines()[-1]

    assert not key.startswith("/")
    assert read == arn


@pytest.mark.soak  # the client of the bucket tries for 20 seconds, and again to read
def test_a_bucket_that_is_away_costs_the_result_and_not_the_work(team: Team, seaweed: Seaweed) -> None:
    environment = {
        **seaweed.environment(endpoint="http://127.0.0.1:9"),
        "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK": RESULTS,
    }
    team.run("python", "-c", MAKE_RESULTS)

    told = team.run("python", "-c", CALL, "", **environment)
    run, arn, _ = told.split()[-3:]
    read = team.run("python", "-c", READ, run, check=False, **environment)

    assert "the result has not been persisted" in told
    assert f"1 world: {arn}" in read
    assert 'Could not connect to the endpoint URL: "http://127.0.0.1:9/simyard-results' in read
