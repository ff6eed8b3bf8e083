"""The quality figures of world generation count what they say."""

import pytest

from benchmarks.worlds import world_quality
from benchmarks.worlds.world_quality import (
    DENSITIES,
    FREE_FLOOR,
    SHAPES,
    TEMPLATES,
    Ask,
    Sampled,
    quality_tables,
    sample_worlds,
    with_density,
    world_figures,
)
from benchmarks.worlds.world_templates import read_template
from specs.data.world import World
from specs.template.body import TemplateBody
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.generate import generate_world

HOUSE = read_template("one-bedroom-house")


@pytest.fixture(scope="module")
def house() -> World:
    return generate_world(HOUSE, seed=1, generation="wgj-1", floorplan_index=1, interior_index=1)


def plan_of(body: TemplateBody):
    return body.Buildings[0].Floors[0].Floorplan


def test_shapes_measured_on_rooms_agree_with_the_certificate(house: World) -> None:
    figures = world_figures(plan_of(HOUSE), house)
    errors = {kind: [w.error for w in house.certificate.wishes if w.kind == kind] for kind in ("area", "aspect")}
    assert list(figures.area_errors) == pytest.approx(errors["area"], abs=1e-5)
    shapes = [room.DesiredShape.AspectRatio for room in plan_of(HOUSE).Rooms]
    wished = [found for found, shape in zip(figures.aspect_deviations, shapes, strict=True) if shape.x != shape.y]
    assert len(wished) == 2
    assert wished == pytest.approx(errors["aspect"], abs=1e-5)


def test_a_wished_way_that_is_not_there_is_not_met(house: World) -> None:
    whole = world_figures(plan_of(HOUSE), house)
    fewer = house.model_copy(update={"passages": house.passages[1:]})
    other = house.model_copy(
        update={"passages": tuple(each.model_copy(update={"kind": "Opening"}) for each in house.passages)}
    )
    assert (whole.connections, whole.connections_met) == (4, 4)
    assert world_figures(plan_of(HOUSE), fewer).connections_met == 3
    assert world_figures(plan_of(HOUSE), other).connections_met == 1


@pytest.mark.parametrize("density", DENSITIES)
def test_a_density_goes_to_every_room_and_replaces_what_was_wished(density: world_quality.Density) -> None:
    body = with_density(HOUSE, density)
    world = generate_world(body, seed=1, generation="wgj-1", floorplan_index=1, interior_index=1)
    wishes = [wish for wish in world.certificate.wishes if wish.kind in ("density", "furniture")]
    assert [wish.subject for wish in wishes] == [room.name for room in world.rooms]
    assert all(wish.wished.startswith(density) for wish in wishes)
    assert plan_of(body) == plan_of(HOUSE)


def test_a_world_that_cannot_be_is_a_failure_with_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    def rejecting(*_: object, **__: object) -> None:
        raise WorldRejected("InvalidInput", "make a room larger")

    monkeypatch.setattr(world_quality, "generate_world", rejecting)
    assert sample_worlds(HOUSE, [4]) == Sampled((), ("seed 4: InvalidInput: make a room larger",))


def test_the_tables_have_a_row_for_every_template_and_a_dash_for_nothing() -> None:
    some = sample_worlds(HOUSE, range(2))
    none = Sampled((), ("seed 0: InvalidInput: too small",) * 2)
    quality: dict[Ask, Sampled] = {(name, density): none for name in TEMPLATES for density in (None, *DENSITIES)}
    quality |= {("one-bedroom-house", density): some for density in (None, *DENSITIES)}
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in quality_tables(quality).splitlines()]
    shapes = rows.index(list(SHAPES))
    assert [row[0] for row in rows[shapes + 2 : shapes + 2 + len(TEMPLATES)]] == list(TEMPLATES)
    assert ["one-room", *("-" for _ in SHAPES[1:])] in rows
    assert ["one-room", "0", "2", *("-" for _ in range(5))] in rows
    free = rows[rows.index(list(FREE_FLOOR)) :]
    assert [row[0] for row in free[2:]] == [
        "Bedroom",
        "Bathroom",
        "Living",
        "Kitchen",
        "Hallway",
        "all rooms",
        "wish met",
    ]
