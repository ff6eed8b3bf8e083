"""Two operators start the same document at the same moment: one job of each kind, and both get its result."""

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord
from tasks.storage.store_url import open_store
from tests.integration.runs import JOB_KINDS, jobs, simyard, small_document, write_document
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration
SEEDS = 24


@pytest.fixture
def document(tmp_path: Path) -> Path:
    """A document whose run takes some seconds."""
    document = small_document()
    document["simulationBatch"]["matrix"]["seeds"] = SEEDS  # pyright: ignore[reportIndexIssue]
    return write_document(tmp_path, document)


def pair(document: Path, store: str, *environments: dict[str, str]) -> list["subprocess.Popen[str]"]:
    return [simyard("run", str(document), "--store", store, **each) for each in environments]


def answers(runs: list["subprocess.Popen[str]"]) -> list[str]:
    """Returns what each run printed, once both have ended well."""
    ended = [(*run.communicate(), run.returncode) for run in runs]
    assert [code for _, _, code in ended] == [0, 0], ended
    return [out for out, _, _ in ended]


def told(answer: str) -> str:
    """Returns the report that a run printed, from its title on."""
    return answer[answer.index("apartment-regression (run-") :]


def assert_one_job_and_both_told(store: str, runs: list["subprocess.Popen[str]"]) -> None:
    one, other = answers(runs)
    assert told(one) == told(other)
    found = jobs(open_store(store))
    assert {kind: [job.status for job in each] for kind, each in found.items()} == {
        kind: ["Succeeded" if kind == "deployment-job" else "Completed"] for kind in JOB_KINDS
    }
    assert f"waiting for process {runs[1].pid}: " in one or f"waiting for process {runs[0].pid}: " in other


@pytest.mark.long
@pytest.mark.usefixtures("prefect_server")
def test_with_one_server_and_a_store_in_a_folder(document: Path, tmp_path: Path) -> None:
    store = (tmp_path / "store").as_uri()
    assert_one_job_and_both_told(store, pair(document, store, {}, {}))


@pytest.mark.soak
def test_each_with_a_server_of_its_own_and_a_store_in_a_bucket(
    document: Path, tmp_path: Path, s3_url: Callable[[], str]
) -> None:
    store = s3_url()
    servers = [{"PREFECT_API_URL": "", "PREFECT_HOME": str(tmp_path / name)} for name in ("one", "other")]
    assert_one_job_and_both_told(store, pair(document, store, *servers))


@pytest.mark.soak
@pytest.mark.usefixtures("prefect_server")
@pytest.mark.parametrize("kind", ["folder", "bucket"])
def test_who_waits_takes_over_from_one_that_is_killed(
    document: Path, tmp_path: Path, s3_url: Callable[[], str], kind: str
) -> None:
    store = (tmp_path / "store").as_uri() if kind == "folder" else s3_url()
    runs = pair(document, store, {}, {})
    opened = open_store(store)
    assert eventually(lambda: any("/000000.json" in key for key in opened.keys("chunks")))
    first, second = sorted(runs, key=lambda run: run.pid != _holder(opened))
    first.send_signal(signal.SIGKILL)
    first.communicate()
    out, err = second.communicate()
    assert second.returncode == 0, err
    assert "everything that was asked for passed" in out
    assert {kind: len(found) for kind, found in jobs(opened).items()} == dict.fromkeys(JOB_KINDS, 1)


def _holder(store: Store) -> int:
    """Returns the number of the process that works on the store's only run."""
    (run,) = jobs(store)["pipeline-run"]
    return ClaimRecord.model_validate_json(store.get(claim_key("pipeline-run", run.id)).body).process.pid
