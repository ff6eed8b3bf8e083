"""What a small quickstart leaves: its report in a real browser, its batch judged again, the same on a bucket."""

import base64
import json
import os
import re
import shutil
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from tasks.server.health import authorization
from tasks.storage.store_url import open_store
from tests.integration.runs import ROOT, assert_same, finished, tables
from tests.servers.chromium import browsing

pytestmark = pytest.mark.integration


@pytest.fixture
def page(small_run: Path) -> Path:
    """The report that the run left beside its tables."""
    (found,) = (small_run / ".simyard" / "buckets" / "results").rglob("report.html")
    return found


def test_the_report_shows_verdict_and_maps_and_asks_for_nothing(page: Path, tmp_path: Path):
    with browsing(tmp_path) as browser:
        browser.look(width=1280, height=900)
        browser.open(page.as_uri())
        assert browser.requests == [page.as_uri()]
        assert browser.complaints == []
        assert browser.run("document.querySelector('.verdict h2').innerText") == "PASS"
        boxes = browser.run("[...document.querySelectorAll('svg.plan')].map(map => map.getBoundingClientRect().height)")
        assert isinstance(boxes, list)
        assert len(boxes) == 2
        assert min(boxes) > 200
        browser.look(width=390, height=844, dark=True)
        assert browser.run("document.documentElement.scrollWidth") == 390


def test_the_report_that_the_run_left_knows_the_verdict_and_what_the_stages_took(page: Path):
    text = page.read_text()
    stages = re.search(r"Where the time went</h2>(.*?)</section>", text, re.DOTALL)
    assert stages is not None
    assert set(re.findall(r'<th scope="row">(\w+)<small>', stages[1])) == {
        "worldGeneration",
        "worldExport",
        "simulationBatch",
        "gate",
        "deployment",
    }
    assert "<title>PASS: apartment-regression</title>" in text


def test_the_command_makes_the_same_page_from_the_arn_of_the_run(small_run: Path, page: Path, tmp_path: Path):
    store = (small_run / ".simyard").as_uri()
    runs = finished("list", "pipeline-runs", "--json", "--store", store).stdout.splitlines()
    before = page.read_bytes()
    done = finished("report", json.loads(runs[-1])["arn"], "--store", store)
    assert (done.returncode, done.stdout.strip()) == (0, page.as_uri()), done.stderr
    assert page.read_bytes() == before


@pytest.mark.long
def test_the_commands_of_the_document_run(small_run: Path, tmp_path: Path):
    shutil.copytree(small_run / ".simyard", tmp_path / ".simyard", symlinks=True)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    (block,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/guide/report.md").read_text(), re.DOTALL)
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [line.rpartition("/")[2] for line in done.stdout.split()] == ["report.html", "report.html"]
    assert (tmp_path / ".simyard" / "report.html").stat().st_size > 10_000


def artifacts(api_url: str, key: str) -> list[dict[str, str]]:
    """Returns what runs left under a key in Prefect's pages, the newest first."""
    body = {"artifacts": {"key": {"any_": [key]}}, "sort": "CREATED_DESC"}
    headers = {"content-type": "application/json", **authorization(os.environ["PREFECT_API_AUTH_STRING"])}
    request = urllib.request.Request(  # noqa: S310 - the test server's own URL
        f"{api_url}/artifacts/filter", json.dumps(body).encode(), headers
    )
    with urllib.request.urlopen(request) as answer:  # noqa: S310 - same
        return json.load(answer)


def test_it_is_in_prefects_pages_in_short_and_as_a_picture(prefect_server: str, small_run: Path):
    reports = [
        each
        for each in artifacts(prefect_server, "apartment-regression--batch-report")
        if small_run.name in each["data"]
    ]
    assert reports[0]["data"].startswith("# ✅ PASS\n\n")
    assert "report.html" in reports[0]["data"]
    run = reports[0]["flow_run_id"]
    pictures = [
        each["data"]
        for each in artifacts(prefect_server, "apartment-regression--batch-picture")
        if each["flow_run_id"] == run
    ]
    kind, _, picture = pictures[0].partition(",")
    assert kind == "data:image/svg+xml;base64"
    assert b"PASS</text>" in base64.b64decode(picture)


def test_the_commands_of_the_document_judge_again_and_leave_the_runs_evidence(small_run: Path, tmp_path: Path):
    shutil.copytree(small_run / ".simyard", tmp_path / ".simyard", symlinks=True)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    (tmp_path / ".venv").symlink_to(sys.prefix)
    (evidence,) = (tmp_path / ".simyard").rglob("evidence.json")
    before = evidence.read_bytes()
    (block,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/guide/gate.md").read_text(), re.DOTALL)
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("INCONCLUSIVE: ")
    assert "its run said PASS" in done.stdout
    assert evidence.read_bytes() == before
    assert [path.name[:6] for path in sorted(evidence.parent.iterdir())][-1:] == ["later-"]


@pytest.mark.long
def test_a_folder_and_s3_hold_the_same_worlds_and_result_tables(small_run: Path, s3_url: Callable[[], str]):
    url = s3_url()
    result = finished("run", str(small_run / "document.yaml"), "--store", url)
    assert result.returncode == 0, result.stderr
    there, here = open_store(url), open_store((small_run / ".simyard").as_uri())
    assert tables(there)["results"].num_rows == 32
    assert_same(there, here)
