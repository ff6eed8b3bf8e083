"""The zip: the same bytes for the same worlds, and a manifest that holds."""

import hashlib
import json
import zipfile
from pathlib import Path

import mujoco
import pytest

from specs.errors import DocumentError
from specs.world import World
from tasks.export.bundle import MANIFEST, write_zip
from tests.worlds_factory import apartment

WORLDS = (apartment(name="world-1-1"), apartment(name="world-1-2"))
FOLDER = "worlds/wgj-0000000000000001"


def test_the_same_worlds_give_the_same_bytes(tmp_path: Path):
    first = write_zip(WORLDS, ["mjcf", "svg"], tmp_path / "first.zip")
    second = write_zip(iter(WORLDS), {"svg", "mjcf"}, tmp_path / "second.zip")
    assert first == second == hashlib.sha256((tmp_path / "first.zip").read_bytes()).hexdigest()
    assert (tmp_path / "first.zip").read_bytes() == (tmp_path / "second.zip").read_bytes()


def test_each_world_has_a_folder_with_the_formats_asked_for(tmp_path: Path):
    write_zip(WORLDS, ["svg"], tmp_path / "plans.zip")
    with zipfile.ZipFile(tmp_path / "plans.zip") as bundle:
        assert bundle.namelist() == [
            f"{FOLDER}/world-1-1/world.json",
            f"{FOLDER}/world-1-1/floorplan.svg",
            f"{FOLDER}/world-1-2/world.json",
            f"{FOLDER}/world-1-2/floorplan.svg",
            MANIFEST,
        ]


def test_the_manifest_names_every_other_file_with_its_digest(tmp_path: Path):
    write_zip(WORLDS, ["mjcf", "svg"], tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as bundle:
        listed = json.loads(bundle.read(MANIFEST))["files"]
        assert set(listed) == set(bundle.namelist()) - {MANIFEST}
        for name, facts in listed.items():
            assert hashlib.sha256(bundle.read(name)).hexdigest() == facts["sha256"]


def test_the_world_in_the_zip_is_the_world(tmp_path: Path):
    write_zip(WORLDS, [], tmp_path / "worlds.zip")
    with zipfile.ZipFile(tmp_path / "worlds.zip") as bundle:
        assert World.model_validate_json(bundle.read(f"{FOLDER}/world-1-2/world.json")) == WORLDS[1]


def test_mujoco_loads_the_zip(tmp_path: Path):
    write_zip(WORLDS[:1], ["mjcf", "svg"], tmp_path / "one.zip")
    with (tmp_path / "one.zip").open("rb") as bundle:
        assert mujoco.MjSpec.from_zip(bundle).compile().geom("sofa-1/seat").size[0] == 1.0


def test_a_world_whose_name_would_leave_its_folder_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match="world"):
        write_zip([apartment(name="../../etc")], [], tmp_path / "evil.zip")


def test_a_world_that_comes_twice_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="twice"):
        write_zip([WORLDS[0], WORLDS[0]], [], tmp_path / "twice.zip")
