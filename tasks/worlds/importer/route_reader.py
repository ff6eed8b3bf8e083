"""Files of routes, places and zones, as robots have them, become the routes and zones of a world.

Read are the routes of AWS's worlds (``poses``), Nav2's waypoints (``waypoints``, a list or named), lists of goals, and
named places (``places``) and routes (``routes``). A pose is ``[x, y, ...]``, ``{x, y}``, or has one of these as its
``position`` or ``pose``; how it is turned is left to whoever drives there. A place is a route of one point, and a zone
has the corners of its outline (``zones``).
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import shapely
import yaml

from specs.base import Fault
from specs.data.world import MOST_ZONE_CORNERS, FloorZone, Route
from tasks.worlds.geometry import rounded
from tasks.worlds.importer.map_reader import is_number
from tasks.worlds.importer.source_files import file_body, refused_file
from tasks.worlds.importer.source_scene import SourceError

_MOST_BYTES = 1 << 20
_MOST_PLACES = 10_000
_FARTHEST_M = 1e5
_LISTS = ("poses", "waypoints", "goals")
_POSE = "[x, y], {x: , y: }, or one of these as position or pose, in metres"
_FILE = "poses, waypoints or goals, a list of poses; or routes, places or zones, by their names"
_OUTLINE = f"3 to {MOST_ZONE_CORNERS} corners of an outline that does not cross itself"


@dataclass(frozen=True)
class NamedWays:
    """What somebody named on a floor.

    Attributes:
        routes: In the order of their files.
        zones: As well.
        files: SHA-256 of each file that was read, by its name.
    """

    routes: tuple[Route, ...]
    zones: tuple[FloorZone, ...]
    files: Mapping[str, str]


def read_routes(paths: Sequence[Path]) -> NamedWays:
    """Returns the routes and zones of files.

    Raises:
        SourceError: One of them is no file of routes, or two routes or zones have a name; carries all faults.
    """
    found, files, faults = dict[tuple[type, str], Route | FloorZone](), dict[str, str](), list[Fault]()
    for number, path in enumerate(paths):
        try:
            body = file_body(path, _MOST_BYTES, "routes")
            files[f"routes/{number}/{path.name}"] = hashlib.sha256(body).hexdigest()
            for each in _named_of(path, body):
                if (type(each), each.name) in found:
                    kind = "zone" if isinstance(each, FloorZone) else "route"
                    faults.append(Fault(path=path.name, value=each.name, allowed=f"a name that no other {kind} has"))
                found[type(each), each.name] = each
        except SourceError as exc:
            faults += exc.faults
    if faults:
        raise SourceError(faults, "routes")
    routes = tuple(each for each in found.values() if isinstance(each, Route))
    return NamedWays(routes, tuple(each for each in found.values() if isinstance(each, FloorZone)), files)


def _named_of(path: Path, body: bytes) -> Iterator[Route | FloorZone]:
    """Yields the routes and zones of one file; the route that has no name is called as the file."""
    try:
        # Aliases make much of a small file, and no tool writes them into one of routes.
        if b"*" in body and any(isinstance(token, yaml.AliasToken) for token in yaml.scan(body)):
            raise refused_file(path, "", "a YAML alias", "the value itself; text with * stands in quotes")
        data: object = yaml.safe_load(body)
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        raise refused_file(path, "", f"no YAML ({exc})", _FILE) from exc
    given = cast("Mapping[object, object]", data if isinstance(data, dict) else {"poses": data})
    listed = [name for name in _LISTS if name in given]
    if len(listed) > 1 or not (listed or given.keys() & {"routes", "places", "zones"}):
        raise refused_file(path, "", " and ".join(listed) or "nothing of a route", _FILE)
    for name in listed:
        yield _route(path, path.stem, given[name], name)
    for name, poses in _named(path, given, "routes"):
        yield _route(path, name, poses, f"routes.{name}")
    for name, pose in _named(path, given, "places"):
        yield _route(path, name, [pose], f"places.{name}")
    for name, corners in _named(path, given, "zones"):
        yield _zone(path, name, corners)


def _named(path: Path, given: "Mapping[object, object]", key: str) -> Iterator[tuple[str, object]]:
    named = given.get(key, {})
    if not isinstance(named, dict):
        raise refused_file(path, key, str(named), "names, each with its own")
    for name, value in cast("Mapping[object, object]", named).items():
        if not isinstance(name, str) or not 0 < len(name) <= 64 or not name.isprintable():
            raise refused_file(path, key, repr(name), "a name of 1 to 64 letters")
        yield name, value


def _route(path: Path, name: str, poses: object, where: str) -> Route:
    """Returns the route through poses: a list, or by names, in the file's order, as Nav2's panel saves them."""
    each = list(cast("Mapping[object, object]", poses).values()) if isinstance(poses, dict) else poses
    if not isinstance(each, list) or not 0 < len(cast("list[object]", each)) <= _MOST_PLACES:
        raise refused_file(path, where, repr(each), f"1 to {_MOST_PLACES:,} poses")
    points = [_place(path, pose, f"{where}[{number}]") for number, pose in enumerate(cast("list[object]", each))]
    return Route(name=name, points_m=tuple(points))


def _zone(path: Path, name: str, corners: object) -> FloorZone:
    where = f"zones.{name}"
    outline = _route(path, name, corners, where).points_m
    if not 3 <= len(outline) <= MOST_ZONE_CORNERS or not shapely.Polygon(outline).is_valid:
        raise refused_file(path, where, repr(corners), _OUTLINE)
    return FloorZone(name=name, outline_m=outline, found=False)


def _place(path: Path, pose: object, where: str) -> tuple[float, float]:
    at = pose
    for key in ("pose", "pose", "position"):  # a stamped pose has a pose that has a position
        at = cast("Mapping[object, object]", at).get(key, at) if isinstance(at, dict) else at
    if isinstance(at, dict):
        fields = cast("Mapping[object, object]", at)
        at = [fields.get("x"), fields.get("y")]
    first = cast("list[object]", at)[:2] if isinstance(at, list) else []
    if len(first) == 2 and all(is_number(value) and abs(value) <= _FARTHEST_M for value in first):
        x_m, y_m = cast("list[float]", first)
        return rounded(float(x_m)), rounded(float(y_m))
    raise refused_file(path, where, repr(pose), _POSE)
