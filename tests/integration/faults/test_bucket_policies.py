"""deploy/iam-*.json on a real S3 server: what each may do is enough, and no more."""

import json
from collections.abc import Callable, Iterator

import pytest

from specs.errors import StoreAccessDenied
from tasks.storage.base.store import Store
from tasks.storage.store_url import connect, open_store
from tests.repository import ROOT
from tests.servers.seaweed import ACCESS_KEY, SECRET_KEY, Seaweed, running_seaweed

pytestmark = pytest.mark.soak
DEPLOY = ROOT / "deploy"
# SeaweedFS has four words for what IAM has many; what removes an object needs the word for writing.
WORDS = {
    "s3:ListBucket": "List",
    "s3:ListBucketMultipartUploads": "List",
    "s3:GetObject": "Read",
    "s3:PutObject": "Write",
    "s3:AbortMultipartUpload": "Write",
    "s3:DeleteObject": "Write",
}
STORE = "s3://simyard-store/main"
As = Callable[[str], Store]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seaweed]:
    folder = tmp_path_factory.mktemp("policies")
    with running_seaweed(folder) as server:
        for bucket in ("simyard-store", "worlds", "results"):
            server.make_bucket(bucket)
        server.kill()
        config = json.loads((folder / "s3.json").read_text())
        config["identities"] += [_identity(name) for name in ("operator", "worker", "robot")]
        (folder / "s3.json").write_text(json.dumps(config))
        server.start_again()
        yield server


@pytest.fixture
def store_as(server: Seaweed, monkeypatch: pytest.MonkeyPatch) -> As:
    """Opens the store with the rights of a policy."""

    def opened(name: str) -> Store:
        for variable, value in server.environment().items():
            monkeypatch.setenv(variable, value)
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", ACCESS_KEY if name == "admin" else name)
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET_KEY if name == "admin" else f"{name}-secret")
        return connect(STORE)

    return opened


@pytest.mark.parametrize("name", ["operator", "worker"])
def test_a_policy_of_people_and_workers_suffices_to_open_and_fill_a_store(name: str, store_as: As):
    store_as(name)
    store = open_store(STORE)

    etag = store.create(f"jobs/{name}.json", b"1")
    store.replace(f"jobs/{name}.json", b"2", etag)

    assert store.get(f"jobs/{name}.json").body == b"2"
    assert f"jobs/{name}.json" in store.keys("jobs")


def test_a_robot_reads_what_it_is_asked_and_writes_its_report(store_as: As):
    store_as("admin").put("robots/r1/desired.json", b"asked")
    robot = store_as("robot")

    robot.put("robots/r1/reported.json", b"done")

    assert robot.get("robots/r1/desired.json").body == b"asked"


@pytest.mark.parametrize("key", ["robots/r1/desired.json", "robots/r2/reported.json", "bundles/b", "trust/t/root.json"])
def test_a_robot_writes_nothing_else(key: str, store_as: As):
    with pytest.raises(StoreAccessDenied):
        store_as("robot").put(key, b"forged")


def test_a_robot_reads_no_jobs_and_no_results(store_as: As):
    store_as("admin").put("jobs/secret.json", b"1")
    with pytest.raises(StoreAccessDenied):
        store_as("robot").get("jobs/secret.json")


def _identity(name: str) -> dict[str, object]:
    found = {
        f"{WORDS[action]}:{_matching(resource.removeprefix('arn:aws:s3:::'))}"
        for statement in json.loads((DEPLOY / f"iam-{name}.json").read_text())["Statement"]
        for action in statement["Action"]
        for resource in statement["Resource"]
    }
    return {"name": name, "credentials": [{"accessKey": name, "secretKey": f"{name}-secret"}], "actions": sorted(found)}


def _matching(resource: str) -> str:
    """SeaweedFS knows buckets, and objects by how their keys begin."""
    return resource if "/" not in resource or resource.endswith("*") else f"{resource}*"
