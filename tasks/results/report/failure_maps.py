"""The report's maps: worlds from above with the ways of failures, and a list of failures beside each.

A report shows a few failures that differ, and not the first hundred of one kind. Drawings are in centimetres, x to the
right, y down the page.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from specs.arn import arn
from specs.base import Spec
from specs.data.outcomes import mark_of
from specs.data.world import FloorZone, Rectangle, Room, Solid, World, corners_m, start_pose
from tasks.results.report.batch_facts import BatchFacts
from tasks.results.report.last_pictures import LastSeen, SeenPicture
from tasks.results.report.rate_tables import clip, short_world
from tasks.results.report.report_columns import (
    NOT_SET,
    PASSED,
    DrivenWorlds,
    Episodes,
    FailedEpisode,
    Failures,
    read_ways,
)

_MARGIN_CM = 8
# What hangs higher is neither met nor seen by a robot on the floor.
_HEAD_M = 1.9
_LETTER_SHARE = 0.56
_LABELS_ACROSS = 30


class RoomDrawing(Spec):
    """A room's floor and its name, in page units.

    Attributes:
        x: Left edge of the rectangle around it; ``y`` is the upper one.
        outline: Path data of a zone; empty for a rectangle.
    """

    x: int
    y: int
    width: int
    height: int
    label: str
    outline: str = ""


class FloorDrawing(Spec):
    """A world from above.

    Attributes:
        view_box: For the SVG.
        x: Left edge of the view box; ``width`` and ``height`` are its size.
        letter: Height of letters that can be read when the drawing is as wide as a phone.
        start: Where the robot starts.
        furniture: Path data of all pieces; ``walls`` and ``doors`` likewise.
    """

    view_box: str
    x: int
    width: int
    height: int
    letter: int
    start: tuple[int, int]
    rooms: tuple[RoomDrawing, ...]
    walls: str
    doors: str
    furniture: str


def draw_floor(world: World) -> FloorDrawing:
    """Returns the drawing of a world."""
    x, y, width, height = _box(world.footprint, _MARGIN_CM)
    letter, start = max(width, height) // _LABELS_ACROSS, start_pose(world)
    return FloorDrawing(
        view_box=f"{x} {y} {width} {height}",
        x=x,
        width=width,
        height=height,
        letter=letter,
        start=(_cm(start.x_m), -_cm(start.y_m)),
        rooms=tuple(_room(area, letter) for area in world.areas),
        walls=_path(world.walls),
        doors=_path(door.leaf for door in world.doors),
        furniture=_path(solid for piece in world.furniture for solid in piece.solids),
    )


def way_path(way_m: Float[np.ndarray, "points 2"]) -> str:
    """Returns path data through points (x m, y m); whole centimetres, each relative to the one before."""
    points = np.rint(way_m * (100.0, -100.0)).astype(int)
    if not len(points):
        return ""
    steps = np.diff(points, axis=0)
    moved = steps[np.any(steps != 0, axis=1)].tolist()
    return f"M{points[0, 0]} {points[0, 1]}" + ("l" + _pairs(moved) if moved else "h0")


def dots_path(points_m: Float[np.ndarray, "points 2"]) -> str:
    """Returns path data that is a dot at each point, where lines have round ends."""
    return "".join(f"M{x} {y}h0" for x, y in np.rint(points_m * (100.0, -100.0)).astype(int).tolist())


def _pairs(steps: list[list[int]]) -> str:
    # A minus sign separates as well as a space.
    text = " ".join(f"{x} {y}" for x, y in steps)
    return text.replace(" -", "-")


def _path(solids: Iterable[Solid]) -> str:
    low = (solid for solid in solids if solid.center_m[2] - solid.half_extents_m[2] < _HEAD_M)
    return "".join(dict.fromkeys(_outline(solid) for solid in low))


def _outline(solid: Solid) -> str:
    x, y = _cm(solid.center_m[0]), -_cm(solid.center_m[1])
    if solid.shape == "cylinder":
        r = max(1, _cm(solid.half_extents_m[0]))
        return f"M{x - r} {y}a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0z"
    return _polygon(corners_m(solid))


def _polygon(outline_m: Iterable[tuple[float, float]]) -> str:
    corners = [(_cm(x_m), -_cm(y_m)) for x_m, y_m in outline_m]
    return f"M{corners[0][0]} {corners[0][1]}L" + " ".join(f"{cx} {cy}" for cx, cy in corners[1:]) + "z"


def _room(area: Room | FloorZone, letter: int) -> RoomDrawing:
    x, y, width, height = _box(area.floor, 0)
    name, most = area.name, int(width / (_LETTER_SHARE * letter))
    label = name if len(name) <= most else f"{name[: max(1, most - 1)]}…"
    outline = _polygon(area.outline_m) if isinstance(area, FloorZone) else ""
    return RoomDrawing(x=x, y=y, width=width, height=height, label=label, outline=outline)


def _box(rectangle: Rectangle, margin: int) -> tuple[int, int, int, int]:
    x, y = _cm(rectangle.x_min_m) - margin, -_cm(rectangle.y_max_m) - margin
    return x, y, _cm(rectangle.x_max_m) + margin - x, -_cm(rectangle.y_min_m) + margin - y


def _cm(metres: float) -> int:
    return round(100.0 * metres)


def simplify(line_m: Float[np.ndarray, "points 2"], tolerance_m: float) -> Float[np.ndarray, "kept 2"]:
    """Returns the first, the last, and as few points between them as keep all others near the line that they make.

    After Douglas and Peucker (1973, Cartographica 10:112): the farthest point from a chord is kept if it is farther
    than the tolerance, and both halves are treated likewise.

    Args:
        line_m: Points (x, y) in order.
        tolerance_m: How far a point that is left out may be from the chord that replaces it.
    """
    if len(line_m) < 3:
        return line_m
    keep = np.zeros(len(line_m), bool)
    keep[[0, -1]] = True
    _mark(line_m, keep, tolerance_m)
    return line_m[keep]


def fit_line(line_m: Float[np.ndarray, "points 2"], tolerance_m: float, most: int) -> Float[np.ndarray, "kept 2"]:
    """Returns the line with as few points as `simplify` leaves, coarser where those were more than ``most``."""
    kept = simplify(line_m, tolerance_m)
    while len(kept) > max(2, most):
        tolerance_m *= 2.0
        kept = simplify(kept, tolerance_m)
    return kept


def _mark(line_m: Float[np.ndarray, "points 2"], keep: Bool[np.ndarray, " points"], tolerance_m: float) -> None:
    waiting = [(0, len(line_m) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        away_m = _distances(line_m[first + 1 : last], line_m[first], line_m[last])
        farthest = int(np.argmax(away_m))
        if away_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            keep[middle] = True
            waiting += [(first, middle), (middle, last)]


def _distances(
    points_m: Float[np.ndarray, "points 2"], begin_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, " points"]:
    """Returns how far points are from a segment, which may be one point."""
    along = end_m - begin_m
    length2 = float(along @ along)
    share = np.clip((points_m - begin_m) @ along / length2, 0.0, 1.0) if length2 else np.zeros(len(points_m))
    nearest = begin_m + share[:, None] * along
    return np.hypot(*(points_m - nearest).T)


# At 24 worlds these are some 400 kB of page, whatever the size of the batch.
LISTED = 6
DRAWN = 24
_APART_M = 0.4


@dataclass(frozen=True)
class FailureChoice:
    """What is shown of one world's failures, as rows of the table of failures.

    Attributes:
        listed: Those that are told one by one, and numbered on the map.
        drawn: Those whose way is drawn, the listed ones among them.
        failures: How many there are in all.
    """

    listed: tuple[int, ...]
    drawn: tuple[int, ...]
    failures: int


def choose_failures(failures: Failures, worlds: Sequence[str]) -> dict[str, FailureChoice]:
    """Returns what is shown of the failures of each of the worlds.

    Reasons take turns, each in the order of the episodes, so that one that is rare is not hidden by one that is not;
    listed are first those that ended apart from one another.
    """
    codes = {name: code for code, name in enumerate(failures.world.names)}
    return {world: _choose(failures, codes.get(world, -1)) for world in worlds}


def _choose(failures: Failures, world: int) -> FailureChoice:
    rows = np.flatnonzero(failures.world.codes == world)
    by_reason = [
        rows[failures.reason.codes[rows] == reason][:DRAWN].tolist() for reason in range(len(failures.reason.names))
    ]
    turns = [row for turn in zip_longest(*by_reason) for row in turn if row is not None]
    drawn = turns[:DRAWN]
    return FailureChoice(
        listed=tuple(sorted(_spread_out(failures, drawn))), drawn=tuple(sorted(drawn)), failures=len(rows)
    )


def _spread_out(failures: Failures, rows: Sequence[int]) -> list[int]:
    far: list[int] = []
    for row in rows:
        ends = failures.final_m[far] - failures.final_m[row]
        if len(far) < LISTED and np.all(np.hypot(*ends.T) > _APART_M):
            far.append(row)
    near = [row for row in rows if row not in far]
    return [*far, *near][:LISTED]


MOST_MAPS = 24
_TOLERANCE_M = 0.03
# So that the drawn ways of all maps are less than a megabyte, however long episodes are.
_POINTS = 160
_DOTS = 150
_LONGEST = 160
_CM = (100.0, -100.0)


class WayDrawing(Spec):
    """Where a failed episode went.

    Attributes:
        mark: Which mark and colour its reason has.
        title: For who asks.
        path: Path data; ``x`` and ``y`` where it ended.
        number: Its number in the list, or empty.
    """

    mark: str
    title: str
    path: str
    x: int
    y: int
    number: str


class ListedFailure(Spec):
    """A failure in words, what its robot saw last, and how to see it again."""

    number: str
    job: int
    mark: str
    reason: str
    circumstances: str
    what: str
    replay: str
    seen: tuple[SeenPicture, ...] = ()


class WorldMap(Spec):
    """A world with its failures.

    Attributes:
        number: Makes its id on the page.
        dots: Path data of where episodes that passed ended.
        failures: How many there are; ``not_drawn`` and ``not_listed`` how many of them are left out.
    """

    number: int
    world: str
    drawing: FloorDrawing
    dots: str
    ways: tuple[WayDrawing, ...]
    listed: tuple[ListedFailure, ...]
    failures: int
    not_drawn: int
    not_listed: int


def worlds_to_map(failures: Failures, worlds: Sequence[str]) -> list[str]:
    """Returns the worlds that are drawn: most failures first, then in the batch's order."""
    counts = dict(
        zip(failures.world.names, np.bincount(failures.world.codes, minlength=len(failures.world.names)), strict=True)
    )
    return sorted(worlds, key=lambda world: -int(counts.get(world, 0)))[:MOST_MAPS]


def world_maps(
    facts: BatchFacts,
    episodes: Episodes,
    failures: Failures,
    failures_file: Path,
    worlds: DrivenWorlds,
    *,
    seen: LastSeen,
) -> list[WorldMap]:
    """Returns maps of the worlds with most failures, as many as are looked at.

    Args:
        facts: The batch.
        episodes: Its episodes.
        failures: Those that did not pass.
        failures_file: ``failures.parquet``, for the ways.
        worlds: Its worlds.
        seen: Finds what robots saw last.
    """
    names = worlds_to_map(failures, [name for name in facts.worlds if name in worlds.rooms])
    picks = choose_failures(failures, names)
    ways = read_ways(failures_file, sorted(row for pick in picks.values() for row in pick.drawn))
    label = short_world(tuple(facts.worlds))
    found: list[WorldMap] = []
    for number, name in enumerate(names, start=1):
        pick = picks[name]
        drawn = failures.read_rows(pick.drawn)
        numbers = {row: str(place) for place, row in enumerate(pick.listed, start=1)}
        found.append(
            WorldMap(
                number=number,
                world=label(name),
                drawing=draw_floor(worlds.load(name)),
                dots=dots_path(_ends(episodes, name)),
                ways=tuple(_way(each, ways[each.row], numbers.get(each.row, "")) for each in drawn),
                listed=tuple(_listed(facts, each, numbers[each.row], seen) for each in drawn if each.row in numbers),
                failures=pick.failures,
                not_drawn=pick.failures - len(pick.drawn),
                not_listed=pick.failures - len(pick.listed),
            )
        )
    return found


def _ends(episodes: Episodes, world: str) -> Float[np.ndarray, "ends 2"]:
    """Returns where episodes of a world that passed ended; of many, some spread evenly over them."""
    code = episodes.world.names.index(world) if world in episodes.world.names else -1
    rows = np.flatnonzero((episodes.world.codes == code) & (episodes.outcome == PASSED))
    return episodes.final_m[rows[:: max(1, -(-len(rows) // _DOTS))]]


def _way(failure: FailedEpisode, way_m: Float[np.ndarray, "poses 2"], number: str) -> WayDrawing:
    line = fit_line(way_m, _TOLERANCE_M, _POINTS)
    x, y = np.rint((line[-1] if len(line) else np.array(failure.final_m)) * _CM).astype(int).tolist()
    title = f"job {failure.index}: {failure.reason} after {failure.simulated_s:.1f} s"
    return WayDrawing(mark=mark_of(failure.reason).name, title=title, path=way_path(line), x=x, y=y, number=number)


def _listed(facts: BatchFacts, failure: FailedEpisode, number: str, seen: LastSeen) -> ListedFailure:
    said = [f"seed {failure.seed}"]
    said += [
        f"{name} {clip(failure.environment.get(name, NOT_SET), 40)}"
        for name, values in facts.variables.items()
        if len(values) > 1
    ]
    said += [f"{failure.goals_reached} of {failure.goals_total} goals"] * bool(failure.goals_total)
    if failure.late or failure.stray:
        said.append(f"lock-step did not hold: {failure.late} stages late, {failure.stray} stray commands")
    return ListedFailure(
        number=number,
        job=failure.index,
        mark=mark_of(failure.reason).name,
        reason=f"{failure.reason} after {failure.simulated_s:.1f} s",
        circumstances=", ".join(said),
        what=clip(failure.failure_reason, _LONGEST),
        replay=f"simyard replay {arn('simulation-job', facts.store, f'{facts.batch}/{failure.index}')}",
        seen=seen(failure),
    )
