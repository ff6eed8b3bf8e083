"""Worlds for Python: of a template, a job, a store or by name, read when they are asked for, and drawn."""

import json
from pathlib import Path

import pytest

import simyard
from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.store_url import open_store
from tasks.storage.worlds import read_world
from tests.factories.batches import PENS, put_worlds
from tests.factories.ros_maps import write_map
from tests.repository import ROOT

TEMPLATE = ROOT / "examples/templates/two-rooms.json"


@pytest.fixture
def store(tmp_path: Path) -> str:
    """The URL of a store with worlds that somebody added."""
    made = open_store((tmp_path / "store").as_uri())
    put_worlds(made, PENS)
    return made.url


def test_a_template_gives_worlds_by_path_or_as_a_body(tmp_path: Path):
    by_path = simyard.worlds(TEMPLATE, count=1, seed=7, store=tmp_path)
    as_body = simyard.worlds(json.loads(TEMPLATE.read_text()), count=1, seed=7, store=tmp_path)
    assert by_path[0].document == as_body[0].document
    assert by_path.title == "two-rooms.json, seed 7"
    assert repr(by_path[0]).startswith("<World 'preview/world-1-1': 2 rooms, ")


def test_one_room_is_one_room(tmp_path: Path):
    studio = simyard.worlds(ROOT / "examples/templates/studio.yaml", count=1, store=tmp_path)
    assert repr(studio[0]).startswith("<World 'preview/world-1-1': 1 room, ")


def test_a_store_has_its_worlds_in_order_and_a_name_is_one_of_them(store: str):
    found = simyard.worlds(store=store)
    assert sorted(found.names) == sorted(PENS)
    assert [each.name for each in simyard.worlds(found.names[1], store=store)] == [found.names[1]]
    assert found[-1].document == read_world(open_store(store), found.names[-1], "test")
    assert found[:1].names == found.names[:1]


def test_a_world_is_read_when_it_is_asked_for(store: str, monkeypatch: pytest.MonkeyPatch):
    found = simyard.worlds(store=store)
    read: list[str] = []
    monkeypatch.setattr("tasks.storage.worlds.read_world", lambda _store, name, _who: read.append(name))
    assert len(found) == len(PENS)
    assert read == []
    next(iter(found))
    assert read == [found.names[0]]


def test_a_notebook_shows_a_plan_and_a_sheet(store: str):
    found = simyard.worlds(store=store)
    assert found[0]._repr_svg_().startswith("<svg")
    assert f'alt="The floor plan of {found.names[0]}"' in found[0]._repr_html_()
    assert f'alt="A sheet of {len(PENS)} of {len(PENS)} worlds"' in found._repr_html_()


def test_an_empty_store_shows_that_there_is_nothing(tmp_path: Path):
    made = open_store((tmp_path / "empty").as_uri())
    assert "no worlds" in simyard.worlds(store=made.url)._repr_html_()


def test_a_run_has_the_buildings_that_its_document_imports_in_the_order_of_their_variants(tmp_path: Path):
    path = write_map(tmp_path, ("#" * 40, *("#" + "." * 38 + "#",) * 40, "#" * 40))
    hall = {"name": "hall", "source": str(path), "start": [2.0, 3.0, 0.0], "variants": 11, "seed": 1, "clutter": 1}
    run = simyard.run({"name": "own", "worlds": [hall]}, store=tmp_path / "store", direct=True)
    worlds = simyard.worlds(run)
    assert [each.name.rpartition("/")[2] for each in worlds] == [f"hall-{number}" for number in range(1, 12)]
    assert worlds[0].document.source is not None


def test_what_is_neither_a_template_nor_a_world_is_told(store: str):
    with pytest.raises(DocumentError, match=r"none\.json"):
        simyard.worlds("none.json", store=store)
    with pytest.raises(ResourceNotFound):
        simyard.worlds("wgj-0123456789abcdef", store=store)


def test_a_building_of_ones_own_is_a_world_of_the_store(tmp_path: Path):
    path = write_map(tmp_path, ("#" * 40, *("#" + "." * 38 + "#",) * 40, "#" * 40))
    hall = simyard.world_import(path, name="hall", start=(2.0, 3.0), wall_height_m=2.5, store=tmp_path / "store")
    assert simyard.worlds(hall.name, store=tmp_path / "store")[0].document == hall.document
    assert repr(hall) == f"<World '{hall.name}': imported from map.yaml, 4 solids, 2.0 x 2.1 m>"
    assert hall.document.source is not None
    assert hall.document.source.settings == ("start=[2, 3, 0]", "wallHeight=2.5")
