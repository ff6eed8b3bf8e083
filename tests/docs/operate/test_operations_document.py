"""docs/operate/operations.md: its settings are the program's."""

import re
from pathlib import Path

import pytest

from specs.settings import chosen_workers
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/operate/operations.md").read_text()
# What an agent's unit reads, and what an agent gives to the programs that it starts.
ON_ROBOTS = {"SIMYARD_TRUST", "SIMYARD_ROBOT", "SIMYARD_ROBOT_ROOT", "SIMYARD_DEPLOYMENT", "SIMYARD_RUN"}


def settings() -> set[str]:
    found = (re.findall(r"\bSIMYARD_[A-Z_]+\b", path.read_text()) for path in _sources())
    return {name for names in found for name in names} - ON_ROBOTS


def _sources() -> list[Path]:
    return [path for folder in ("specs", "tasks", "flows") for path in (ROOT / folder).rglob("*.py")]


def test_every_setting_has_a_row() -> None:
    rows = set(re.findall(r"^\| `(SIMYARD_\w+)` \|", DOCUMENT, flags=re.MULTILINE))
    assert rows == settings()


@pytest.mark.parametrize("value", re.findall(r"^\| `SIMYARD_WORKERS=(.*?)` \|", DOCUMENT, flags=re.MULTILINE))
def test_every_way_to_name_workers_is_understood(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_WORKERS", value)
    workers = chosen_workers()
    assert (workers.kind if workers else "") == ("ray" if "ray" in value else "dask" if value else "")
