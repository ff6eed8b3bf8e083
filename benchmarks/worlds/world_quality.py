"""How good worlds are: what they make of their templates' wishes, over many seeds.

Shapes, areas and connections are measured here on rooms and passages against the template, not read from certificates.
"""

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import get_args

import numpy as np
from pydantic import JsonValue

from benchmarks.harness import markdown
from benchmarks.worlds.world_templates import HOMES, SAMPLES, read_template
from specs.data.world import Rectangle, RoomType, World, solids
from specs.template.body import AspectRatio, FloorplanTemplate, TemplateBody
from specs.template.interior import Density, FurnitureArrangementSet, InteriorFurnishings, RoomTypeList
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.generate import generate_world

DENSITIES: tuple[Density, ...] = get_args(Density)
ROOM_TYPES: tuple[RoomType, ...] = get_args(RoomType)
TEMPLATES = (*SAMPLES, *HOMES)
_CHUNK = 20

Ask = tuple[str, Density | None]
"""A template by name, and the density that all its rooms shall have; None leaves the template as it is."""


@dataclass(frozen=True)
class WorldFigures:
    """What one world makes of its template.

    Attributes:
        area_errors: By room, |area - wished| / wished.
        slimness: By room, its longer side over its shorter one.
        aspect_deviations: By room, by what share its proportions miss the wished ones.
        footprint_deviation: The same of the building.
        connections: How many ways between rooms were wished.
        connections_met: How many of them there are, of the wished kind.
        free_floor: Room type and free share of the floor, by room.
        wishes: Kinds of the certificate's wishes.
        unmet: Kinds of those that are not met.
        radius_m: Largest robot radius with which every room is reached.
    """

    area_errors: tuple[float, ...]
    slimness: tuple[float, ...]
    aspect_deviations: tuple[float, ...]
    footprint_deviation: float
    connections: int
    connections_met: int
    free_floor: tuple[tuple[RoomType, float], ...]
    wishes: tuple[str, ...]
    unmet: tuple[str, ...]
    sub_seed: int
    radius_m: float
    solids: int


@dataclass(frozen=True)
class Sampled:
    """What came of one template: figures of the worlds, and reasons of those that failed."""

    worlds: tuple[WorldFigures, ...]
    failures: tuple[str, ...]


def with_density(body: TemplateBody, density: Density) -> TemplateBody:
    """Returns a template that wants this density, and nothing else of the furniture, in all rooms."""
    arrangement = FurnitureArrangementSet(
        Name="all", TargetSet=RoomTypeList(RoomTypes=ROOM_TYPES), DesiredSpatialDensity=density
    )
    building, floor = body.Buildings[0], body.Buildings[0].Floors[0]
    furnishings = InteriorFurnishings(FurnitureArrangements=(arrangement,))
    interior = floor.Interior.model_copy(update={"Furniture": furnishings})
    floor = floor.model_copy(update={"Interior": interior})
    return body.model_copy(update={"Buildings": (building.model_copy(update={"Floors": (floor,)}),)})


def world_figures(plan: FloorplanTemplate, world: World) -> WorldFigures:
    """Returns the figures of a world that was made from a floor plan's template."""
    floors = {room.name: room.floor for room in world.rooms}
    types: dict[str, RoomType] = {room.name: room.type for room in world.rooms}
    areas = [(_area(floors[room.Name]), room.DesiredShape.Area) for room in plan.Rooms]
    aspects = [(_aspect(floors[room.Name]), _ratio(room.DesiredShape.AspectRatio)) for room in plan.Rooms]
    wished = Counter((frozenset(wish.Location), wish.ConnectionType) for wish in plan.DesiredConnections)
    built = Counter((frozenset(passage.rooms), passage.kind) for passage in world.passages)
    certificate = world.certificate
    return WorldFigures(
        area_errors=tuple(abs(found - wish) / wish for found, wish in areas),
        slimness=tuple(max(found, 1.0 / found) for found, _ in aspects),
        aspect_deviations=tuple(_deviation(found, wish) for found, wish in aspects),
        footprint_deviation=_deviation(_aspect(world.footprint), _ratio(plan.Footprint.DesiredAspectRatio)),
        connections=wished.total(),
        connections_met=(wished & built).total(),
        free_floor=tuple((types[room.room], room.free_floor_share) for room in certificate.rooms),
        wishes=tuple(wish.kind for wish in certificate.wishes),
        unmet=tuple(wish.kind for wish in certificate.wishes if not wish.met),
        sub_seed=world.sub_seed,
        radius_m=certificate.reachable_robot_radius_m,
        solids=len(solids(world)),
    )


def _area(box: Rectangle) -> float:
    return (box.x_max_m - box.x_min_m) * (box.y_max_m - box.y_min_m)


def _aspect(box: Rectangle) -> float:
    return (box.x_max_m - box.x_min_m) / (box.y_max_m - box.y_min_m)


def _ratio(aspect: AspectRatio) -> float:
    return aspect.x / aspect.y


def _deviation(found: float, wished: float) -> float:
    return max(found / wished, wished / found) - 1.0


def sample_worlds(body: TemplateBody, seeds: Sequence[int]) -> Sampled:
    """Returns what comes of a template: the first world of each seed."""
    worlds: list[WorldFigures] = []
    failures: list[str] = []
    plan = body.Buildings[0].Floors[0].Floorplan
    for seed in seeds:
        try:
            world = generate_world(body, seed=seed, generation="quality", floorplan_index=1, interior_index=1)
        except WorldRejected as rejected:
            failures.append(f"seed {seed}: {rejected}")
        else:
            worlds.append(world_figures(plan, world))
    return Sampled(tuple(worlds), tuple(failures))


def measure_quality(seeds: int) -> dict[Ask, Sampled]:
    """Returns what comes of each template as it is, and with each density in all rooms; takes all cores."""
    chunks = [range(first, min(first + _CHUNK, seeds)) for first in range(0, seeds, _CHUNK)]
    asked: list[Ask] = [(name, density) for name in TEMPLATES for density in (None, *DENSITIES)]
    # Spawned, because the parent may have threads.
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), mp_context=get_context("spawn")) as pool:
        parts = {ask: [pool.submit(_sample, ask, chunk) for chunk in chunks] for ask in asked}
        return {ask: _joined([part.result() for part in each]) for ask, each in parts.items()}


def _sample(ask: Ask, seeds: Sequence[int]) -> Sampled:
    name, density = ask
    body = read_template(name)
    return sample_worlds(body if density is None else with_density(body, density), seeds)


def _joined(parts: Sequence[Sampled]) -> Sampled:
    worlds = tuple(world for part in parts for world in part.worlds)
    return Sampled(worlds, tuple(failure for part in parts for failure in part.failures))


Quality = Mapping[Ask, Sampled]

SHAPES = (
    "template", "area error", "long:short", "p95", "aspect off by", "p95", "footprint off by", "p95",
    "connections met", "plans with all",
)  # fmt: skip
WISHES = ("template", "all wishes met", "unmet wishes, share of their kind")
GUARANTEES = (
    "template", "worlds", "failed", "tried again", "radius p5 (m)", "least (m)", "solids mean", "most",
)  # fmt: skip
FREE_FLOOR = ("free floor", *DENSITIES)
NONE = "-"


def quality_tables(quality: Quality) -> str:
    """Returns the tables, each under its name."""
    as_is = {name: quality[name, None] for name in TEMPLATES}
    tables = {
        "Rooms and connections": markdown([SHAPES, *(_shapes(name, each.worlds) for name, each in as_is.items())]),
        "Guarantees": markdown([GUARANTEES, *(_guarantees(name, each) for name, each in as_is.items())]),
        "Wishes": markdown([WISHES, *(_wishes(name, each.worlds) for name, each in as_is.items())]),
        "Free floor by density": markdown([FREE_FLOOR, *_free_floor(quality)]),
    }
    return "\n\n".join(f"{heading}:\n\n{table}" for heading, table in tables.items())


def _shapes(name: str, worlds: Sequence[WorldFigures]) -> tuple[str, ...]:
    if not worlds:
        return (name, *(NONE for _ in SHAPES[1:]))
    areas = [error for world in worlds for error in world.area_errors]
    slimness = [each for world in worlds for each in world.slimness]
    aspects = [deviation for world in worlds for deviation in world.aspect_deviations]
    footprints = [world.footprint_deviation for world in worlds]
    wished = sum(world.connections for world in worlds)
    met = sum(world.connections_met for world in worlds)
    whole = sum(world.connections_met == world.connections for world in worlds)
    return (
        name,
        f"{100 * np.mean(areas):.2f} %",
        f"{np.mean(slimness):.2f}",
        f"{np.percentile(slimness, 95):.2f}",
        f"{100 * np.mean(aspects):.0f} %",
        f"{100 * np.percentile(aspects, 95):.0f} %",
        f"{100 * np.mean(footprints):.0f} %",
        f"{100 * np.percentile(footprints, 95):.0f} %",
        f"{100 * met / wished:.1f} %" if wished else NONE,
        f"{100 * whole / len(worlds):.1f} %" if wished else NONE,
    )


def _guarantees(name: str, sampled: Sampled) -> tuple[str, ...]:
    worlds = sampled.worlds
    head = (name, f"{len(worlds)}", f"{len(sampled.failures)}")
    if not worlds:
        return (*head, *(NONE for _ in GUARANTEES[3:]))
    radii = [world.radius_m for world in worlds]
    counts = [world.solids for world in worlds]
    again = sum(world.sub_seed > 0 for world in worlds)
    return (
        *head,
        f"{again}",
        f"{np.percentile(radii, 5):.2f}",
        f"{min(radii):.2f}",
        f"{np.mean(counts):.0f}",
        f"{max(counts)}",
    )


def _wishes(name: str, worlds: Sequence[WorldFigures]) -> tuple[str, ...]:
    if not worlds:
        return name, NONE, NONE
    wished = Counter(kind for world in worlds for kind in world.wishes)
    unmet = Counter(kind for world in worlds for kind in world.unmet)
    shares = (f"{kind} {100 * count / wished[kind]:.0f} %" for kind, count in unmet.most_common())
    whole = sum(not world.unmet for world in worlds)
    return name, f"{100 * whole / len(worlds):.0f} %", ", ".join(shares) or NONE


def _free_floor(quality: Quality) -> list[tuple[str, ...]]:
    """Returns rows by room type, over all templates: mean, p5 to p95, and how many of these wishes count as met."""
    worlds = {density: [w for name in TEMPLATES for w in quality[name, density].worlds] for density in DENSITIES}
    rows = [
        (kind, *(_free(worlds[density], (kind,)) for density in DENSITIES))
        for kind in ROOM_TYPES
        if any(each == kind for world in worlds[DENSITIES[0]] for each, _ in world.free_floor)
    ]
    met: list[str] = []
    for density in DENSITIES:
        wished = sum(world.wishes.count("density") for world in worlds[density])
        unmet = sum(world.unmet.count("density") for world in worlds[density])
        met.append(f"{100 * (1 - unmet / wished):.0f} %" if wished else NONE)
    every = tuple(_free(worlds[density], ROOM_TYPES) for density in DENSITIES)
    return [*rows, ("all rooms", *every), ("wish met", *met)]


def _free(worlds: Sequence[WorldFigures], kinds: Sequence[RoomType]) -> str:
    shares = [100 * share for world in worlds for kind, share in world.free_floor if kind in kinds]
    if not shares:
        return NONE
    return f"{np.mean(shares):.0f} % ({np.percentile(shares, 5):.0f}-{np.percentile(shares, 95):.0f})"


TEMPLATE, SEED = "two-rooms", 15
_WIDTH = 128


def example_certificate() -> str:
    """Returns the certificate as a block of JSON, what fits into a line on a line."""
    world = generate_world(
        read_template(TEMPLATE), seed=SEED, generation="preview", floorplan_index=1, interior_index=1
    )
    return f"```json\n{_lines(world.certificate.model_dump(mode='json'), 0)}\n```"


def _lines(data: JsonValue, indent: int) -> str:
    line = json.dumps(data)
    if not isinstance(data, dict | list) or (indent and indent + len(line) <= _WIDTH):
        return line
    named = data.items() if isinstance(data, dict) else (("", each) for each in data)
    parts = [(f"{json.dumps(name)}: " if name else "") + _lines(each, indent + 2) for name, each in named]
    inside = ",\n".join(" " * (indent + 2) + part for part in parts)
    begin, end = "{}" if isinstance(data, dict) else "[]"
    return f"{begin}\n{inside}\n{' ' * indent}{end}"
