"""docs/operate/operations.md, Housekeeping: its commands run, and its table has every kind that can go."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from specs.job_kinds import JOB_KINDS
from tasks.housekeeping import object_kinds
from tasks.housekeeping.machine import _ENTRIES, unused_entries
from tasks.storage.base.store import Store
from tests.housekeeping.yard import Yard
from tests.repository import ROOT

SECTION = (ROOT / "docs/operate/operations.md").read_text().split("## Housekeeping\n")[1].split("\n## ")[0]
_LINES = [line for block in re.findall(r"```sh\n(.*?)```", SECTION, flags=re.DOTALL) for line in block.splitlines()]


@pytest.mark.long
def test_every_command_runs_and_only_yes_removes(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Yard(file_store).lose(Yard(file_store).generation("lost"))
    monkeypatch.setenv("SIMYARD_STORE", file_store.url)
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    before = file_store.keys("")
    for line in _LINES:
        command = [str(Path(sys.executable).with_name("simyard")), *line.split()[1:]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, ""), line
    assert len(_LINES) == 4
    assert file_store.keys("") == before  # all of it is younger than the grace


def test_every_kind_that_can_go_has_a_row() -> None:
    rows = " ".join(re.findall(r"^\| (.*?) \|", SECTION, flags=re.MULTILINE))
    constants = {
        name: value for name, value in vars(object_kinds).items() if re.fullmatch(r"[A-Z_]+", name) and name[0] != "_"
    }
    kept_by_jobs = {each.what for declared in JOB_KINDS.values() for each in declared.objects}
    kinds = kept_by_jobs | {value for value in constants.values() if isinstance(value, str) and "/" not in value}
    assert len(kinds) == 17
    assert [kind for kind in kinds if kind not in rows] == []


def test_every_kind_of_the_cache_has_a_row(tmp_path: Path) -> None:
    for folder in _ENTRIES.values():
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "old").write_bytes(b"1")
    (row,) = re.findall(r"^\| (compiled programs, .*) \| this machine", SECTION, flags=re.MULTILINE)
    found = unused_entries(tmp_path, 0.0)
    assert len(found) == len(_ENTRIES)
    assert [entry.what for entry in found if entry.what.split()[-1] not in row and "data" not in entry.what] == []
