"""Worlds that a stranger wrote, through the command: they are refused by name, and nothing beside them is read.

What each reader refuses: tests/worlds/importer/test_hostile_sources.py, test_map_reader.py and test_route_reader.py.
"""

import json
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner
from tests.factories.ros_maps import write_map
from tests.worlds.importer.sources import model, shared_model, world

pytestmark = [pytest.mark.integration, pytest.mark.long]
KEPT = "what the owner keeps"


@pytest.fixture
def home(owner: Owner) -> Path:
    """Returns the folder of what the owner keeps, beside the buildings of strangers."""
    home = owner.folder / "home"
    home.mkdir()
    (home / "kept.yaml").write_text(f"{KEPT}: [1, 2]\n")
    shared_model(home, "kept", model("kept"))
    write_map(home)
    return home


def _building(owner: Owner, name: str) -> Path:
    folder = owner.folder / name / "worlds"
    folder.mkdir(parents=True)
    return folder


def test_worlds_that_name_what_lies_elsewhere_are_refused_each_by_its_name(owner: Owner, home: Path) -> None:
    linked, entity, image, picture = (_building(owner, name) for name in ("linked", "entity", "image", "picture"))
    (linked / "models").mkdir()
    (linked / "models" / "crate").symlink_to(home / "kept")
    (entity / "w.world").write_text(f"<!DOCTYPE sdf [<!ENTITY e SYSTEM 'file://{home}/kept.yaml'>]><sdf>&e;</sdf>")
    (picture / "map.pgm").symlink_to(home / "map.pgm")
    sources = {
        "linked": world(linked, "<include><uri>model://crate</uri></include>"),
        "entity": entity / "w.world",
        "image": write_map(image, body=b"", image="../../home/map.pgm"),
        "picture": write_map(picture, body=b""),
    }
    worlds = [{"name": name, "source": str(path.relative_to(owner.folder))} for name, path in sources.items()]
    (owner.folder / "buildings.yaml").write_text(json.dumps({"name": "buildings", "worlds": worlds}))
    done = owner.simyard("run", "buildings.yaml", "--direct")
    assert (done.returncode, KEPT in done.stdout) == (2, False)
    assert [name for name in sources if f"{name}/worlds/" not in done.stdout] == []
    assert not list(owner.folder.rglob("import-*"))


def test_a_map_that_a_link_leads_to_is_not_compared_with(owner: Owner, home: Path) -> None:
    building = _building(owner, "building")
    (building.parent / "maps").mkdir()
    (building.parent / "maps" / "robot").symlink_to(home)
    done = owner.simyard("world", "import", str(world(building, model("crate"))), "--start=5,5")
    assert (done.returncode, "agree" in done.stdout) == (0, False)
