"""docs/operate/operations.md: results in a bucket, and a store whose credentials only a block has."""

import re
from uuid import uuid4

import pytest

from tests.integration.prefect_features.team import Team
from tests.repository import ROOT
from tests.servers.seaweed import ACCESS_KEY, SECRET_KEY, Seaweed

pytestmark = pytest.mark.integration
DOCUMENT = (ROOT / "docs/operate/operations.md").read_text()
(MAKE_RESULTS,) = [
    block for block in re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL) if "RemoteFileSystem" in block
]
RESULTS = "remote-file-system/simyard-results"
CALL = """
import sys
from flows.prefect.flows import world_generation
spec = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}, "seed": 51}
state = world_generation(spec, store=sys.argv[1] or None, base="examples", return_state=True)
print(state.state_details.flow_run_id, state.result().arn, state.data.metadata.storage_key)
"""
MAKE_BLOCKS = """
import sys
try:
    from prefect_aws import AwsCredentials, S3Bucket
except ImportError:
    from tests.integration.prefect_features.aws_blocks import AwsCredentials, S3Bucket
key, secret, endpoint, bucket, folder = sys.argv[1:]
reach = {"endpoint_url": endpoint}
credentials = AwsCredentials(aws_access_key_id=key, aws_secret_access_key=secret, aws_client_parameters=reach)
credentials.save("team", overwrite=True)
S3Bucket(bucket_name=bucket, bucket_folder=folder, credentials=credentials).save("team-store", overwrite=True)
"""
READ = """
import sys
from prefect.client.orchestration import get_client
from simyard.flow import result_of
state = get_client(sync_client=True).read_flow_run(sys.argv[1]).state
print(state.message)
print(result_of(state).arn)
"""
PARAMETERS = """
import sys
from prefect.client.orchestration import get_client
print(get_client(sync_client=True).read_flow_run(sys.argv[1]).parameters)
"""
EXAMPLE = """
import runpy, sys
example = runpy.run_path("examples/prefect/sub_flows.py")
from flows.prefect.flows import simulation_batch
from flows.prefect.flows import world_export
from flows.prefect.flows import world_generation
worlds = world_generation(example["WorldGeneration"].model_validate(example["WORLDS"]), sys.argv[1], "examples")
names = worlds.detail["worlds"]
export = {"outputLocation": {"s3Bucket": "results"}, "formats": ["svg"]}
print(world_export(export, names, sys.argv[1]).detail["zip"])
batch = example["SimulationBatch"].model_validate(example["BATCH"])
print(simulation_batch(batch, names, sys.argv[1]).detail["results_url"])
"""
NO_CREDENTIALS = {"AWS_EC2_METADATA_DISABLED": "true", "AWS_DEFAULT_REGION": "us-east-1"}


@pytest.mark.long
def test_another_machine_reads_a_result_from_the_bucket(team: Team, seaweed: Seaweed) -> None:
    seaweed.make_bucket("simyard-results")
    environment = {**seaweed.environment(), "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK": RESULTS}
    team.run("python", "-c", MAKE_RESULTS)

    run, arn, key = team.run("python", "-c", CALL, "", more=environment).split()[-3:]
    other = {**seaweed.environment(), "PREFECT_HOME": str(team.folder / "other machine")}
    read = team.run("python", "-c", READ, run, more=other).splitlines()[-1]

    assert not key.startswith("/")
    assert read == arn


@pytest.mark.soak  # the client of the bucket tries for 20 seconds, and again to read
def test_a_bucket_that_is_away_costs_the_result_and_not_the_work(team: Team, seaweed: Seaweed) -> None:
    environment = {
        **seaweed.environment(endpoint="http://127.0.0.1:9"),
        "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK": RESULTS,
    }
    team.run("python", "-c", MAKE_RESULTS)

    told = team.run("python", "-c", CALL, "", more=environment)
    run, arn, _ = told.split()[-3:]
    read = team.run("python", "-c", READ, run, check=False, more=environment)

    assert "the result has not been persisted" in told
    assert f"1 world: {arn}" in read
    assert 'Could not connect to the endpoint URL: "http://127.0.0.1:9/simyard-results' in read


@pytest.mark.long
def test_a_block_has_the_store_and_its_credentials(team: Team, seaweed: Seaweed) -> None:
    folder = uuid4().hex
    seaweed.make_bucket("simyard-store")
    team.run(
        *("python", "-c", MAKE_BLOCKS, ACCESS_KEY, SECRET_KEY, seaweed.endpoint, "simyard-store", folder),
    )

    by_bucket = team.run("python", "-c", CALL, "block://s3-bucket/team-store", more=NO_CREDENTIALS)
    by_place = team.run(
        "python", "-c", CALL, f"block://aws-credentials/team/simyard-store/{folder}", more=NO_CREDENTIALS
    )
    kept = team.run("python", "-c", PARAMETERS, by_bucket.split()[-3])

    of_stores = [told.split()[-2].split(":")[3] for told in (by_bucket, by_place)]
    assert of_stores[0] == of_stores[1]  # the id that the store got when it was first opened
    assert "block://s3-bucket/team-store" in kept
    assert SECRET_KEY not in by_bucket + by_place + kept


@pytest.mark.soak
def test_a_batch_and_an_export_reach_the_documents_buckets_with_the_blocks_credentials(
    team: Team, seaweed: Seaweed
) -> None:
    for bucket in ("simyard-store", "results"):
        seaweed.make_bucket(bucket)
    team.run("python", "-c", MAKE_BLOCKS, ACCESS_KEY, SECRET_KEY, seaweed.endpoint, "simyard-store", uuid4().hex)

    told = team.run(
        *("python", "-c", EXAMPLE, "block://s3-bucket/team-store"), more={**NO_CREDENTIALS, "SIMYARD_BUCKETS": "s3://"}
    )

    zipped, results = told.splitlines()[-2:]
    assert zipped.startswith("s3://results/")
    assert results.startswith("s3://results/")


@pytest.mark.long
def test_a_block_that_is_not_there_is_a_fault_of_the_parameters(team: Team) -> None:
    told = team.run("python", "-c", CALL, "block://s3-bucket/nobody", check=False)

    assert "store: 'block://s3-bucket/nobody': a block that Prefect's server has: prefect block ls" in told
