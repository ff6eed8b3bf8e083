"""docs/guide/applications.md, on versions: what it tells one to type, typed in its order."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from specs.errors import DocumentError
from specs.robomaker.bundle import VERSIONS_AT_MOST
from tasks.applications.registry import resolve
from tasks.applications.versions import known_application
from tasks.storage.buckets import source_faults
from tasks.storage.store_url import open_store
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/applications.md").read_text()
TYPED = "".join(re.findall(r"^```versions\n(.*?)^```$", DOCUMENT, flags=re.MULTILINE | re.DOTALL))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where it was typed, beside two bundles and a store."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    monkeypatch.setenv("SIMYARD_STORE", (tmp_path / "store").as_uri())
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    for name in ("amd", "arm"):
        (tmp_path / name / "guide").mkdir(parents=True)
        (tmp_path / name / "guide" / "run.sh").write_text(f"#!/bin/sh\necho {name}\n")
        (tmp_path / name / "guide" / "run.sh").chmod(0o755)
    typed = subprocess.run(["bash", "-euo", "pipefail", "-c", TYPED], check=False, capture_output=True, text=True)
    assert typed.returncode == 0, typed.stderr
    return tmp_path


@pytest.mark.long
@pytest.mark.integration
def test_what_it_says_one_types_makes_the_versions_that_it_tells_of(folder: Path) -> None:
    store = open_store((folder / "store").as_uri())

    assert [each.number for each in known_application(store, "robot-application", "guide").versions] == [2]
    assert list(resolve(store, "robot-application", "guide").digests) == ["X86_64", "ARM64"]
    ranger = resolve(store, "robot-application", "ranger")
    assert list(ranger.digests) == ["ARM64"]
    assert source_faults(store, ranger, "version") == []
    (folder / "store/buckets/builds/guide-arm.tar").write_bytes(b"another")
    (fault,) = source_faults(store, ranger, "version")
    assert "RobotApplicationVersionMismatchedEtag" in fault.value
    with pytest.raises(DocumentError):
        resolve(store, "robot-application", "guide", "1")


def test_its_number_of_versions_is_the_programs() -> None:
    assert f"at most {VERSIONS_AT_MOST} versions" in DOCUMENT
