"""What a program follows from: whatever is different of it makes another program."""

import shutil
from pathlib import Path

import pytest

from tasks.simulate.engines.program_cache import applications_identity
from tests.factories.simulations import FOLDERS, ROBOT, SCENARIO

LAUNCHES = (ROBOT, SCENARIO)
BUNDLES = (FOLDERS[ROBOT.digest], FOLDERS[SCENARIO.digest])
KNOWN = applications_identity(LAUNCHES, BUNDLES, ("SPEED",), {"MODE": "fast"})


def test_launches_names_and_texts_are_part_of_it():
    other = ROBOT.model_copy(update={"launch_file": "other"})
    found = {
        KNOWN,
        applications_identity((other, SCENARIO), BUNDLES, ("SPEED",), {"MODE": "fast"}),
        applications_identity(LAUNCHES, BUNDLES, ("TIME",), {"MODE": "fast"}),
        applications_identity(LAUNCHES, BUNDLES, ("SPEED",), {"MODE": "slow"}),
        applications_identity((ROBOT.model_copy(update={"digest": "1" * 64}), SCENARIO), BUNDLES, ("SPEED",), {}),
    }
    assert len(found) == 5


def test_any_file_of_a_folder_that_is_no_sealed_bundle_is_part_of_it(tmp_path: Path):
    for folder in BUNDLES:
        shutil.copytree(folder, tmp_path / folder.name)
    copies = (tmp_path / BUNDLES[0].name, tmp_path / BUNDLES[1].name)
    before = applications_identity(LAUNCHES, copies, (), {})
    assert applications_identity(LAUNCHES, copies, (), {}) == before
    (copies[1] / "map.bin").write_bytes(b"another map")
    assert applications_identity(LAUNCHES, copies, (), {}) != before


def test_a_text_that_names_a_file_makes_a_program_that_is_not_kept(tmp_path: Path):
    assert KNOWN
    assert applications_identity(LAUNCHES, BUNDLES, (), {"MAP": str(tmp_path)}) == ""
    assert applications_identity(LAUNCHES, BUNDLES, (), {"MAP": str(tmp_path / "nothing")}) != ""
    assert applications_identity(LAUNCHES, BUNDLES, (), {"LONG": "/" + "x" * 9000}) != ""


def test_a_mounted_data_source_lies_where_its_digest_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    mount = tmp_path / "data" / "mounts" / ("0" * 64) / "files"
    mount.mkdir(parents=True)
    assert applications_identity(LAUNCHES, BUNDLES, (), {"MAP": str(mount)}) != ""
