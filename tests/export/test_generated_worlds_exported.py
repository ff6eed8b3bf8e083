"""What the generator makes is what the exporter writes: many capabilities, so it stands above their folders."""

import json
from xml.etree import ElementTree as ET

import mujoco
import pytest

from specs.data.world import World, solids
from specs.template.body import TemplateBody
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.export.format.formats import format_files
from tasks.export.format.mjcf import MJCF_FILE, mjcf_files, world_spec
from tasks.results.playback.plan_drawings import failure_map_svg
from tasks.storage.worlds import encode_world
from tasks.worlds.generate import generate_world
from tests.factories.episodes import collided
from tests.repository import ROOT

TEMPLATE = ROOT / "examples" / "templates" / "two-rooms.json"


@pytest.fixture(scope="module", params=range(1, 4))
def world(request: pytest.FixtureRequest) -> World:
    template = TemplateBody.model_validate(json.loads(TEMPLATE.read_text()))
    return generate_world(template, seed=request.param, generation="wgj-1", floorplan_index=1, interior_index=1)


def test_the_zip_holds_the_very_bytes_of_the_store(world: World):
    assert list(format_files(world, "world").values()) == [encode_world(world)]


def test_mujoco_sees_every_solid(world: World):
    files = mjcf_files(world)
    model = mujoco.MjModel.from_xml_string(files.pop(MJCF_FILE).decode(), files)
    assert {model.geom(number).name for number in range(model.ngeom)} >= {solid.name for solid in solids(world)}


def test_nothing_in_the_model_touches_the_certified_start(world: World):
    spec = world_spec(world)
    body = spec.worldbody.add_body(name="start", pos=[0.0, 0.0, 0.251])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.999, 0.25, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_the_plan_is_an_svg(world: World):
    assert ET.fromstring(floor_plan_svg(world)).tag.endswith("svg")  # noqa: S314 - our own document


def test_failures_can_be_drawn_on_the_plan(world: World):
    assert "<polyline" in failure_map_svg(floor_plan_svg(world), [("b/0", collided(0))])
