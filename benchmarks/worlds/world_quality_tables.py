"""The quality tables of docs/guide/worlds.md, in Markdown."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.harness import markdown
from benchmarks.worlds.world_quality import DENSITIES, ROOM_TYPES, TEMPLATES, Ask, Sampled, WorldFigures
from specs.data.world import RoomType

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
