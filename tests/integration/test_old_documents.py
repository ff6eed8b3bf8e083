"""A CreateSimulationJob of RoboMaker's guide, from `plan` to `describe`, with a file that it reads."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tasks.applications.registry import publish_bundle
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tests.factories.simulations import BUNDLES, pen
from tests.integration.runs import ROOT, finished

pytestmark = pytest.mark.integration
SAMPLE = ROOT / "tests/data/samples/requests/create-simulation-job.vpc.json"
WORLD = "arn:aws:robomaker:us-west-2:111111111111:world/generation-1/world-1"
ROTATE = """
from pathlib import Path

from .pushing import Pushing


def controller(environment):
    assert (Path(environment["DATA_SOURCE_MAPS"]) / "maps/one.yaml").read_text() == "walls: []"
    return Pushing(0.0)
"""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A store with what the document refers to: two applications, a world, and a file in a bucket."""
    store = open_store((tmp_path / "store").as_uri())
    robot, scenario = tmp_path / "robot", tmp_path / "scenario"
    shutil.copytree(BUNDLES / "faulty/faulty", robot / "hello_world_robot")
    shutil.copy(BUNDLES / "faulty/robot.xml", robot / "robot.xml")
    (robot / "hello_world_robot/rotate.py").write_text(ROTATE)
    (scenario / "hello_world_simulation").mkdir(parents=True)
    shutil.copy(BUNDLES / "drift/drift/endless.py", scenario / "hello_world_simulation/empty_world.py")
    publish_bundle(store, "robot-application", "MyRobotApplication", robot)
    publish_bundle(store, "simulation-application", "MySimulationApplication", scenario)
    store.put(world_key("generation-1", "world-1"), pen(4.5, 0).model_dump_json().encode())
    open_bucket(store, "my-data").put("maps/one.yaml", b"walls: []")
    return store


def document(folder: Path) -> Path:
    """Returns the sample, with a shorter duration, a world and a data source."""
    request: dict[str, Any] = json.loads(SAMPLE.read_text())
    request["maxJobDurationInSeconds"] = 5
    request["simulationApplications"][0]["worldConfigs"] = [{"world": WORLD}]
    request["dataSources"] = [{"name": "maps", "s3Bucket": "my-data", "s3Keys": ["maps/"], "type": "Prefix"}]
    file = folder / "old job.json"
    file.write_text(json.dumps(request))
    return file


def answer(store: Store, *command: str) -> Any:  # noqa: ANN401 - JSON
    result = finished(*command, "--store", store.url)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.long
def test_an_old_document_of_a_single_job_runs_as_it_stands(tmp_path: Path, store: Store):
    file = document(tmp_path)
    request = json.loads(file.read_text())
    planned = finished("plan", str(file), "--store", store.url)
    assert planned.returncode == 0, planned.stderr
    assert "old-job" in planned.stdout
    assert "no effect         simulationBatch.createSimulationJobRequests[*].vpcConfig" in planned.stdout
    assert "dataSources" not in planned.stdout
    ran = finished("run", "--direct", str(file), "--store", store.url)
    assert ran.returncode == 0, ran.stderr
    line = answer(store, "list", "simulation-jobs", "--json")
    assert (line["status"], line["dataSourceNames"]) == ("Completed", ["maps"])
    job = answer(store, "describe", line["arn"])
    assert job["simulationTimeMillis"] == 5000
    for field in ("iamRole", "failureBehavior", "vpcConfig", "maxJobDurationInSeconds", "outputLocation"):
        assert job[field] == request[field]
    assert job["simulationApplications"][0]["worldConfigs"][0]["world"].endswith(":generation-1/world-1")
    assert any((tmp_path / "store/buckets/my-bucket/my-output-folder").rglob("results.parquet"))
    again = finished("restart", line["arn"], "--store", store.url)
    assert again.returncode == 2
    assert "this one is Completed" in again.stderr
