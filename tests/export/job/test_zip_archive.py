"""The zip: the same bytes for the same worlds, and a manifest that holds."""

import hashlib
import json
import zipfile
from pathlib import Path

import mujoco
import pytest

from specs.data.world import World
from specs.errors import DocumentError
from specs.pipeline.world_sections import FORMATS
from tasks.export.job.world_files import MANIFEST, write_zip
from tests.factories.worlds import apartment

WORLDS = (apartment(name="world-1-1"), apartment(name="world-1-2"))
GENERATION = "wgj-0000000000000001"


def test_the_same_worlds_give_the_same_bytes(tmp_path: Path):
    first = write_zip(WORLDS, FORMATS, tmp_path / "first.zip")
    second = write_zip(iter(WORLDS), set(FORMATS), tmp_path / "second.zip")
    assert first == second == hashlib.sha256((tmp_path / "first.zip").read_bytes()).hexdigest()
    assert (tmp_path / "first.zip").read_bytes() == (tmp_path / "second.zip").read_bytes()


def test_each_format_has_a_folder_and_each_world_its_place_in_it(tmp_path: Path):
    write_zip(WORLDS, ["svg", "map"], tmp_path / "plans.zip")
    with zipfile.ZipFile(tmp_path / "plans.zip") as bundle:
        assert bundle.namelist() == [
            f"world/{GENERATION}/world-1-1.json",
            f"map/{GENERATION}/world-1-1/map.pgm",
            f"map/{GENERATION}/world-1-1/map.yaml",
            f"svg/{GENERATION}/world-1-1.svg",
            f"world/{GENERATION}/world-1-2.json",
            f"map/{GENERATION}/world-1-2/map.pgm",
            f"map/{GENERATION}/world-1-2/map.yaml",
            f"svg/{GENERATION}/world-1-2.svg",
            MANIFEST,
        ]


def test_gazebo_finds_robomakers_workspace_with_shared_models_once(tmp_path: Path):
    write_zip(WORLDS, ["sdf"], tmp_path / "gazebo.zip")
    with zipfile.ZipFile(tmp_path / "gazebo.zip") as bundle:
        names = [name.removeprefix("workspace_src/src/") for name in bundle.namelist() if name.startswith("workspace")]
    worlds = [name for name in names if name.endswith(".world")]
    assert worlds == [
        f"aws_robomaker_worldforge_worlds/worlds/{name}/{name}.world"
        for name in (f"generation_{GENERATION}_world-1-1", f"generation_{GENERATION}_world-1-2")
    ]
    models = [name for name in names if "_shared_models/models/" in name and name.endswith("model.sdf")]
    assert len(models) == len(WORLDS[0].furniture)
    assert "aws_robomaker_worldforge_worlds/launch/world.launch" in names


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
        assert World.model_validate_json(bundle.read(f"world/{GENERATION}/world-1-2.json")) == WORLDS[1]


def test_mujoco_loads_the_zip_whatever_else_is_in_it(tmp_path: Path):
    write_zip(WORLDS[:1], FORMATS, tmp_path / "one.zip")
    with (tmp_path / "one.zip").open("rb") as bundle:
        assert mujoco.MjSpec.from_zip(bundle).compile().geom("sofa-1/seat").size[0] == 1.0


def test_a_world_whose_name_would_leave_its_folder_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match="world"):
        write_zip([apartment(name="../../etc")], [], tmp_path / "evil.zip")


def test_a_world_that_comes_twice_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="twice"):
        write_zip([WORLDS[0], WORLDS[0]], [], tmp_path / "twice.zip")
