"""A world with less furniture: measured anew, marked, and else what it was; and added to a store only if it is so."""

from pathlib import Path

import pytest

from specs.data.world import Wish, World
from specs.errors import DocumentError
from specs.template.body import TemplateBody
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.worlds import encode_world
from tasks.worlds.certificate import broken_guarantees, keep_furniture
from tasks.worlds.generate import generate_world
from tasks.worlds.job.stored_worlds import add_world
from tests.repository import ROOT

TEMPLATE = TemplateBody.model_validate_json((ROOT / "examples" / "templates" / "two-rooms.json").read_bytes())


@pytest.fixture(scope="module")
def world() -> World:
    return generate_world(TEMPLATE, seed=7, generation="wgj-1", floorplan_index=1, interior_index=1)


@pytest.fixture(scope="module")
def half(world: World) -> World:
    return keep_furniture(world, {piece.name for piece in world.furniture[::2]}, TEMPLATE)


@pytest.mark.parametrize("template", [TEMPLATE, None])
def test_with_all_its_furniture_a_world_measures_what_its_generator_measured(
    world: World, template: TemplateBody | None
):
    again = keep_furniture(world, {piece.name for piece in world.furniture}, template)
    assert again.map == world.map
    left_out = {"wishes"}
    assert again.certificate.model_dump(exclude=left_out) == world.certificate.model_dump(exclude=left_out)
    assert again.certificate.wishes[-1].met


def test_the_wishes_of_a_known_template_are_weighed_anew(world: World, half: World):
    assert [wish.kind for wish in half.certificate.wishes[:-1]] == [wish.kind for wish in world.certificate.wishes]


def test_what_was_taken_out_is_gone_from_map_and_certificate(world: World, half: World):
    assert half.furniture == world.furniture[::2]
    assert half.map.runs != world.map.runs
    assert half.certificate.free_floor_share > world.certificate.free_floor_share
    assert broken_guarantees(half.certificate) == ()


def test_nobody_takes_it_for_a_world_that_was_generated(world: World, half: World):
    assert half.generator == f"{world.generator}-shrunk"
    assert half.certificate.unmet[-1].startswith(f"all rooms: {len(half.furniture)} left, wished")
    assert keep_furniture(half, set(), None).generator == half.generator


def test_without_a_template_wishes_about_furniture_are_left_out(world: World):
    full = Wish(kind="density", subject="Living room", wished="Dense", found="Dense", met=True)
    said = world.certificate.model_copy(update={"wishes": (*world.certificate.wishes, full)})
    bare = keep_furniture(world.model_copy(update={"certificate": said}), set(), None).certificate
    kinds = {wish.kind for wish in bare.wishes[:-1]}
    assert kinds
    assert not kinds & {"furniture", "density"}
    assert bare.area_error_mean == world.certificate.area_error_mean


def test_a_world_is_added_once_under_its_name(file_store: Store, half: World, tmp_path: Path):
    file = tmp_path / "world.json"
    file.write_bytes(encode_world(half))
    for _ in range(2):
        assert add_world(file_store, file) == "wgj-1/world-1-1"
    assert file_store.get(world_key("wgj-1", "world-1-1")).body == encode_world(half)


def test_a_world_does_not_take_the_name_of_another(file_store: Store, world: World, half: World, tmp_path: Path):
    file_store.put(world_key("wgj-1", "world-1-1"), encode_world(world))
    file = tmp_path / "world.json"
    file.write_bytes(encode_world(half))
    with pytest.raises(DocumentError, match="a name that no other world has there"):
        add_world(file_store, file)
    assert file_store.get(world_key("wgj-1", "world-1-1")).body == encode_world(world)


def test_a_world_that_says_what_is_not_so_is_refused(file_store: Store, world: World, half: World, tmp_path: Path):
    file = tmp_path / "world.json"
    for claimed in ({"certificate": world.certificate}, {"map": world.map}):
        file.write_bytes(encode_world(half.model_copy(update=claimed)))
        with pytest.raises(DocumentError, match="what is measured on the world's geometry"):
            add_world(file_store, file)


def test_what_is_no_world_is_refused(file_store: Store, tmp_path: Path):
    file = tmp_path / "world.json"
    with pytest.raises(DocumentError, match="the document of a world"):
        add_world(file_store, file)
    file.write_text("{}")
    with pytest.raises(DocumentError, match="the document of a world"):
        add_world(file_store, file)
