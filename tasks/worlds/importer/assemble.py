"""A scene becomes a world: its outline, where a robot starts, what of the source is in it, and its measured floor."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from specs.base import Fault, canonical_json
from specs.data.world import (
    ROBOT_RADIUS_M,
    WORLD_VERSION,
    Certificate,
    FloorZone,
    Furniture,
    ImportFinding,
    ImportReport,
    Light,
    MapAgreement,
    OccupancyMap,
    Rectangle,
    Route,
    Solid,
    Start,
    World,
    WorldSource,
)
from specs.pipeline.world_sections import SourceKind
from tasks.worlds.geometry import CELL_M, HEADROOM_M, Box, bounding_box, bounds, label_parts, rounded, solid_rows
from tasks.worlds.importer.floor_rooms import found_rooms
from tasks.worlds.importer.own_floor import cell_at, measured, own_floor, reached_from
from tasks.worlds.importer.source_scene import MOST_SOLIDS, Scene, SourceError
from tasks.worlds.survey import ExactGrid

IMPORTER = "simyard-import-7"
"""Changes whenever the same source would give another world."""
MOST_CELLS = 1 << 24
"""Of a floor, whose map would grow beyond what a machine holds for every lane: 42,000 m2."""
LEAST_RADIUS_M = 0.05
"""Of the smallest robot; a start has room for it."""
_WALL, _BUILDING = "wall", "building"
"""What is in the name of walls, and what an export calls all of them together."""
_WALL_M = 0.1
_BESIDE_START_M = 1.0
_FURTHEST_START_M = 20.0
_LIGHT_BELOW_M = 0.1
# A footprint stands off what it holds, so that rounding moves nothing into the next cell of its grid.
_HAIR_M = 2e-6
_MOST_SHARE = 0.5
_UNMEASURED = Certificate(
    origin_clear_radius_m=0.0,
    guaranteed_robot_radius_m=0.0,
    reachable_robot_radius_m=0.0,
    doors_as_set_robot_radius_m=0.0,
    narrowest_passage_m=0.0,
    free_floor_share=0.0,
    area_error_mean=0.0,
    overlaps=0,
)


@dataclass(frozen=True)
class ImportedAs:
    """What is said of an imported world beside its scene.

    Attributes:
        name: The world's.
        kind: What the source is.
        file: Its file's name, without folders.
        start: Where a robot starts; None for the source's own place, else one that is found.
        settings: What was asked for beside the file, by the names of the document.
        agreements: With maps that lie beside the source.
    """

    name: str
    kind: SourceKind
    file: str
    start: Start | None = None
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    agreements: Sequence[MapAgreement] = ()


def assemble_world(scene: Scene, described: ImportedAs) -> World:
    """Returns the world of a scene, in the scene's frame, measured; the same scene gives the same bytes.

    Its generation is named by all that it was made from, so that importing a source again makes nothing new.

    Raises:
        SourceError: Nothing stands in it, it is too large, or no robot can start where it shall.
    """
    walls = tuple(solid for piece in scene.pieces if _is_wall(piece) for solid in piece.solids)
    furniture = tuple(piece for piece in scene.pieces if not _is_wall(piece))
    solids = [*walls, *(solid for piece in furniture for solid in piece.solids)]
    asked = described.start or scene.start
    footprint = _footprint(solids, asked, described)
    ceiling_m = max([HEADROOM_M, *(solid.center_m[2] + solid.half_extents_m[2] for solid in solids)])
    source = _source(scene, described)
    world = World(
        version=WORLD_VERSION,
        generator=IMPORTER,
        template_digest="",
        seed=0,
        generation=_generation(source),
        name=described.name,
        floorplan_index=0,
        interior_index=0,
        ceiling_height_m=rounded(ceiling_m),
        wall_thickness_m=_WALL_M,
        footprint=footprint,
        rooms=(),
        passages=(),
        walls=walls,
        furniture=furniture,
        lights=(),
        map=OccupancyMap(resolution_m=CELL_M, origin_m=(0.0, 0.0), columns=0, rows=0, runs=(0,)),
        certificate=_UNMEASURED,
        source=source,
    )
    bare = own_floor(world.model_copy(update={"furniture": ()}))
    grid = bare.with_solids([solid for piece in furniture for solid in piece.solids])
    routes, lost = _kept_routes(grid, scene.routes, described.file)
    start = _checked_start(grid, asked, described.file) if asked else _find_start(grid, described.file)
    zones, shut = _kept_zones(grid, scene.zones, start, described.file)
    report = ImportReport(
        parts=scene.parts,
        exact=scene.exact,
        findings=(*scene.findings, *lost, *shut, *_out_of_reach(grid, start)),
        agreements=tuple(described.agreements),
    )
    lights = scene.lights or (Light(position_m=(start.x_m, start.y_m, rounded(ceiling_m - _LIGHT_BELOW_M))),)
    update: dict[str, object] = {"start": start, "report": report, "lights": lights, "routes": routes or None}
    update["walks"] = scene.walks or None
    update["zones"] = zones or found_rooms(bare, start) or None
    return measured(world.model_copy(update=update), floor=grid)


def _is_wall(piece: Furniture) -> bool:
    """Returns whether a piece is a part of the building, as its name or its model's tells."""
    return piece.name == _BUILDING or _WALL in f"{piece.name} {piece.model_type}".lower()


def _source(scene: Scene, described: ImportedAs) -> WorldSource:
    return WorldSource(
        kind=described.kind,
        file=described.file,
        digest=hashlib.sha256(canonical_json({**scene.files})).hexdigest(),
        settings=tuple(f"{name}={described.settings[name]}" for name in sorted(described.settings)),
    )


def _generation(source: WorldSource) -> str:
    """Returns what the folder of a world is called: by source, settings and importer."""
    made_of = {"importer": IMPORTER, **source.model_dump(mode="json")}
    return f"import-{hashlib.sha256(canonical_json(made_of)).hexdigest()[:16]}"


def _footprint(solids: Sequence[Solid], start: Start | None, described: ImportedAs) -> Rectangle:
    """Returns the rectangle that holds all solids, and a start beside them; a map ends where its cells do.

    Raises:
        SourceError: Nothing stands, or too much, it is too large, or the start is not beside it.
    """
    file = described.file
    if not 0 < len(solids) <= MOST_SOLIDS:
        allowed = f"a world in which something stands that a robot could meet, in at most {MOST_SOLIDS:,} solids"
        raise SourceError([Fault(path="solids", value=f"{len(solids):,}", allowed=allowed)], file)
    around = bounds(solid_rows(solids))
    box = Box(*around[:, :2].min(axis=0).tolist(), *around[:, 3:5].max(axis=0).tolist()).grown(_HAIR_M)
    if start and not _holds(box, start):
        outer_m = 0.0 if described.kind == "map" else _FURTHEST_START_M
        if not _holds(box.grown(outer_m), start):
            allowed = f"a place within {_range_text(box, 'x')} and {_range_text(box, 'y')}"
            allowed += f", or at most {outer_m:g} m beside it" if outer_m else ""
            raise SourceError([Fault(path="start", value=f"[{start.x_m:g}, {start.y_m:g}]", allowed=allowed)], file)
        place = Box(start.x_m, start.y_m, start.x_m, start.y_m)
        box = bounding_box([box, place.grown(_BESIDE_START_M)])
    if box.area > MOST_CELLS * CELL_M**2:
        value = f"{box.width:.0f} x {box.height:.0f} m"
        allowed = f"a floor of at most {MOST_CELLS * CELL_M**2:,.0f} m2: cut the source, or see its unit"
        raise SourceError([Fault(path="size", value=value, allowed=allowed)], file)
    low_x, low_y, high_x, high_y = (rounded(side) for side in box)
    return Rectangle(x_min_m=low_x, y_min_m=low_y, x_max_m=high_x, y_max_m=high_y)


def _holds(box: Box, start: Start) -> bool:
    return box.x_min < start.x_m < box.x_max and box.y_min < start.y_m < box.y_max


def _range_text(box: Box, axis: Literal["x", "y"]) -> str:
    low, high = (box.x_min, box.x_max) if axis == "x" else (box.y_min, box.y_max)
    return f"{axis} {low:.1f} to {high:.1f}"


def _checked_start(grid: ExactGrid, start: Start, file: str) -> Start:
    """Returns a start, if the smallest robot can stand there.

    Raises:
        SourceError: It cannot; says where it could.
    """
    cell = cell_at(grid, (start.x_m, start.y_m))
    if cell and grid.free(LEAST_RADIUS_M)[cell]:
        return start
    clear_m = float(grid.distance_m[cell]) if cell else 0.0
    other = _find_start(grid, file)
    value = f"[{start.x_m:g}, {start.y_m:g}], {clear_m:.2f} m from the nearest solid"
    allowed = f"a place with {LEAST_RADIUS_M} m around it, such as [{other.x_m:g}, {other.y_m:g}]"
    raise SourceError([Fault(path="start", value=value, allowed=allowed)], file)


def _kept_routes(grid: ExactGrid, routes: Sequence[Route], file: str) -> tuple[tuple[Route, ...], list[ImportFinding]]:
    """Returns routes without the places where not even the smallest robot can stand, and what was left out.

    Raises:
        SourceError: A route has no other places: it is of another building, or in another frame.
    """
    free, kept, lost, faults = grid.free(LEAST_RADIUS_M), list[Route](), list[ImportFinding](), list[Fault]()
    for route in routes:
        cells = [cell_at(grid, place) for place in route.points_m]
        left = tuple(at for at, cell in zip(route.points_m, cells, strict=True) if cell is not None and free[cell])
        if left:
            kept.append(route.model_copy(update={"points_m": left}))
        else:
            x, y = route.points_m[0]
            allowed = f"places with {LEAST_RADIUS_M} m around them, in the frame of {file}"
            faults.append(Fault(path=f"route {route.name}", value=f"[{x:g}, {y:g}] and all others", allowed=allowed))
        for number, (at, cell) in enumerate(zip(route.points_m, cells, strict=True), start=1):
            if at not in left:
                clear = "not on the floor" if cell is None else f"{grid.distance_m[cell]:.2f} m from a solid"
                subject = f"route {route.name}, place {number}"
                lost.append(ImportFinding(subject=subject, became="dropped", why=f"[{at[0]:g}, {at[1]:g}] is {clear}"))
    if faults:
        raise SourceError(faults, file)
    return tuple(kept), lost


def _kept_zones(
    grid: ExactGrid, zones: Sequence[FloorZone], start: Start, file: str
) -> tuple[tuple[FloorZone, ...], list[ImportFinding]]:
    """Returns the zones that the smallest robot gets to, and what was left out.

    Raises:
        SourceError: It gets to none of them: they are of another building, or in another frame.
    """
    if not zones:
        return (), []
    reached = np.nonzero(reached_from(grid, start, LEAST_RADIUS_M))
    x, y = (middles[cells] for middles, cells in zip(grid.centers_m, reached, strict=True))
    kept = tuple(zone for zone in zones if zone.holds(x, y).any())
    if not kept:
        (low_x, low_y), where = zones[0].outline_m[0], f"zone {zones[0].name}"
        allowed = f"a part of the floor that a robot gets to, in the frame of {file}"
        raise SourceError([Fault(path=where, value=f"[{low_x:g}, {low_y:g}] and all others", allowed=allowed)], file)
    why = f"no robot of {LEAST_RADIUS_M} m radius gets there from the start"
    lost = [zone for zone in zones if zone not in kept]
    return kept, [ImportFinding(subject=f"zone {zone.name}", became="dropped", why=why) for zone in lost]


def _find_start(grid: ExactGrid, file: str) -> Start:
    """Returns a place from which a usual robot reaches as much floor as it can.

    It is the origin, if that is as good; else the place with the most room, and of such the nearest to their middle.

    Raises:
        SourceError: Not even the smallest robot can stand anywhere.
    """
    for radius_m in (ROBOT_RADIUS_M, LEAST_RADIUS_M):
        part = _largest_part(grid, radius_m)
        origin = cell_at(grid, (0.0, 0.0))
        if origin and part[origin]:
            return Start(x_m=0.0, y_m=0.0)
        if part.any():
            return _widest_place(grid, part)
    allowed = f"floor for a robot of {LEAST_RADIUS_M} m radius"
    raise SourceError([Fault(path="floor", value="none that is free", allowed=allowed)], file)


def _largest_part(grid: ExactGrid, radius_m: float) -> np.ndarray:
    """Returns the cells of the largest floor that hangs together for a robot; none where there is none."""
    labels = label_parts(grid.free(radius_m))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return (labels == int(sizes.argmax())) & (labels > 0)


def _widest_place(grid: ExactGrid, part: np.ndarray) -> Start:
    cells = np.argwhere(part & (grid.distance_m >= grid.distance_m[part].max() - _HAIR_M))
    x, y = cells[((cells - cells.mean(axis=0)) ** 2).sum(axis=1).argmin()].tolist()
    return Start(x_m=rounded(float(grid.centers_m[0][x])), y_m=rounded(float(grid.centers_m[1][y])))


def _out_of_reach(grid: ExactGrid, start: Start) -> Iterator[ImportFinding]:
    """Yields that a start is shut in, where most of the floor is elsewhere."""
    reached = int(np.count_nonzero(reached_from(grid, start, LEAST_RADIUS_M)))
    most = int(np.count_nonzero(_largest_part(grid, LEAST_RADIUS_M)))
    if reached < _MOST_SHARE * most:
        why = (
            f"a robot of {LEAST_RADIUS_M} m radius gets to {reached * CELL_M**2:.1f} m2 of floor "
            f"from its start, and {most * CELL_M**2:.1f} m2 hang together elsewhere"
        )
        yield ImportFinding(subject="floor", became="dropped", why=why)
