"""A version with a build for each of two architectures, from `publish` to robots of both: driven, or named."""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from tasks.storage.store_url import open_store
from tests.attacks.conftest import Owner
from tests.integration.runs import own_cache
from tests.integration.small_robots import FLEET, ROBOT, bundle, document, done, publish

pytestmark = [pytest.mark.integration, pytest.mark.long]


@pytest.fixture
def owner(tmp_path: Path) -> Owner:
    """Somebody with an ARM64 robot."""
    folder, url = tmp_path / "owner", (tmp_path / "store").as_uri()
    folder.mkdir()
    made = Owner(url, folder, {**os.environ, "SIMYARD_STORE": url, "SIMYARD_CACHE": own_cache(tmp_path / "cache")})
    done(made, "fleet", "create", FLEET)
    done(made, "fleet", "register", FLEET, ROBOT, "--architecture", "ARM64")
    return made


def _published(owner: Owner, folder: Path) -> str:
    """Returns the digest of the build for ARM64, as `publish` prints it."""
    own, other = bundle(folder / "own"), bundle(folder / "other", folder / "other-ran")
    said = publish(owner, "--architecture", f"X86_64={own}", "--architecture", f"ARM64={other}")
    (digest,) = re.findall("([0-9a-f]{64}) ARM64", said)
    return digest


def _changed(owner: Owner, change: dict[str, Any], *, driven: bool = False) -> str:
    file = Path(document(owner))
    content = json.loads(file.read_text())
    content["deployment"].update(change)
    if driven:
        (request,) = content["simulationBatch"]["createSimulationJobRequests"]
        (use,) = request["robotApplications"]
        both = [request, {**request, "robotApplications": [{**use, "architecture": "ARM64"}]}]
        content["simulationBatch"]["createSimulationJobRequests"] = both
    file.write_text(json.dumps(content))
    return str(file)


def _evidence(owner: Owner) -> dict[str, Any]:
    store = open_store(owner.url)
    (key,) = [key for key in store.keys("results") if key.endswith("evidence.json")]
    return json.loads(store.get(key).body)


def test_a_build_that_the_document_names_reaches_its_robots_and_the_report_says_so(owner: Owner, tmp_path: Path):
    digest = _published(owner, tmp_path)
    file = _changed(owner, {"untestedBuilds": {"ARM64": {"testedAs": "X86_64", "digest": digest}}})
    ended = owner.simyard("run", file, "--direct")
    assert ended.returncode == 0, ended.stdout
    assert (tmp_path / "other-ran").exists()
    assert {"architecture": "ARM64", "digest": digest, "tested_as": "X86_64"} in _evidence(owner)["ships"]["builds"]
    store = open_store(owner.url)
    (page,) = [store.get(key).body.decode() for key in store.keys("buckets/results") if key.endswith("report.html")]
    stands = "NOT SIMULATED; the document says that the build for X86_64 stands for it"
    assert f"slider version 1 for ARM64, {digest[:12]}: {stands}" in page


@pytest.mark.soak
def test_a_build_that_a_request_drives_reaches_its_robots_by_the_evidence(owner: Owner, tmp_path: Path):
    digest = _published(owner, tmp_path)
    ended = owner.simyard("run", _changed(owner, {}, driven=True), "--direct")
    assert ended.returncode == 0, ended.stdout
    assert (tmp_path / "other-ran").exists()
    evidence = _evidence(owner)
    assert [each["digest"] for each in evidence["robots"] if each["architecture"] == "ARM64"] == [digest]
    assert {"architecture": "ARM64", "digest": digest} in evidence["ships"]["builds"]
