"""A map of ROS, as map_server and Nav2 load it, becomes a scene: what is occupied stands as walls.

Cells are read as nav2_map_server reads them: trinary, scale and raw. A cell is occupied, free, or
neither. Occupied ones become upright boxes that are exact; where free floor ends at cells that nobody knows, these
stand, too, so that no robot leaves the map. Boxes of cells need no tolerance, and as many contours would be no fewer.
"""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeGuard, cast

import numpy as np
import yaml
from jaxtyping import Bool, Float, Int

from specs.base import Fault
from specs.data.world import Furniture, ImportFinding, Solid
from tasks.worlds.geometry import rounded
from tasks.worlds.importer.source_scene import MOST_SOLIDS, Scene, SourceError

if TYPE_CHECKING:
    from PIL.Image import Image

Mode = Literal["trinary", "scale", "raw"]
Cells = Bool[np.ndarray, "rows columns"]
MAP_WALL_M = 2.0
"""How high walls of a map stand unless somebody says so: as high as anything is in a robot's way."""
MOST_PIXELS = 1 << 24
"""4,096 x 4,096: a hall of 200 m x 200 m at 5 cm."""
_THRESHOLDS: Mapping[str, float] = {"occupied_thresh": 0.65, "free_thresh": 0.25}
_SAVED = "image, resolution and origin, as map_saver writes them"
_MOST_WHOLE = 10**9
_MOST_YAML_BYTES = 1 << 16
_MOST_IMAGE_BYTES = 1 << 28
# Walls keep off the borders of their cells, so that rounding lets none touch the next cell.
_HAIR_M = 4e-6
_GREY = (0.6, 0.6, 0.6)
_PAPER = (0.8, 0.78, 0.72)
_LEAST_LOOSE_M, _MOST_LOOSE_M = 0.2, 2.5
# More than these are noise.
_MOST_LOOSE = 1_000
_FORMATS = ("PPM", "PNG", "BMP")
# Of floating pictures and of 16 bits, which Pillow gives as whole numbers.
_WIDE_MODES = ("I", "I;16", "I;16B", "I;16L")


@dataclass(frozen=True)
class MapDescription:
    """What the YAML file of a map says.

    Attributes:
        image: Name of the picture, from the file's folder.
        resolution_m: Side of a cell.
        origin: Where the lower left corner of the picture is (x, y, in metres), and its turn (rad).
        negate: Whether dark is free.
        occupied_above: A cell is occupied whose darkness, 0-1, is above.
        free_below: A cell is free whose darkness is below.
    """

    image: str
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_above: float
    free_below: float
    mode: Mode


class KnownCells(NamedTuple):
    """Which cells are occupied and which are free, from the lowest y and x on; of the others nothing is known."""

    occupied: Cells
    free: Cells


def read_map(path: Path, wall_height_m: float = MAP_WALL_M) -> Scene:
    """Returns a map of ROS as a scene in the map's frame.

    Args:
        path: The YAML file; its picture lies in its folder or below.
        wall_height_m: How high everything stands that is occupied.

    Raises:
        SourceError: It is no map; carries all faults that could be found.
    """
    described, text = _read_description(path)
    picture = _picture_path(path, described.image)
    cells, body = _read_cells(path, picture, described)
    if not cells.free.any():
        raise _refused(path, described.image, "no cell is free", "a picture with floor: see negate and free_thresh")
    edge = _beside(cells.free) & ~cells.occupied & ~cells.free
    walls, edges = merged_cells(cells.occupied), merged_cells(edge)
    if len(walls) + len(edges) > MOST_SOLIDS:
        allowed = f"a map whose occupied cells are at most {MOST_SOLIDS:,} rectangles: clear it of noise"
        raise _refused(path, "image", f"{described.image!r}: more rectangles than that", allowed)
    pieces = _pieces(walls, edges, _loose_blobs(cells, described.resolution_m), described, wall_height_m)
    occupied = int(cells.occupied.sum())
    return Scene(
        pieces=pieces,
        parts=occupied,
        exact=occupied,
        findings=tuple(_edge_finding(edge, cells, described)),
        files={path.name: _digest(text), described.image: _digest(body)},
    )


def read_floor(path: Path) -> tuple[KnownCells, MapDescription]:
    """Returns what a map of ROS knows of its cells, and what it says of itself.

    Raises:
        SourceError: It is no map; carries all faults that could be found.
    """
    described, _ = _read_description(path)
    return _read_cells(path, _picture_path(path, described.image), described)[0], described


def _digest(body: bytes) -> str:
    return hashlib.sha256(body).hexdigest()


def _refused(path: Path, where: str, value: str, allowed: str) -> SourceError:
    return SourceError([Fault(path=where, value=value, allowed=allowed)], str(path))


# The description.


def _read_description(path: Path) -> tuple[MapDescription, bytes]:
    """Returns what the YAML file says, and its bytes."""
    try:
        with path.open("rb") as file:
            body = file.read(_MOST_YAML_BYTES + 1)
        data = yaml.safe_load(body) if len(body) <= _MOST_YAML_BYTES else None
    except OSError as exc:
        raise _refused(path, "file", exc.strerror or "cannot be read", "a map's YAML file that can be read") from exc
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        why = " ".join(str(exc).split())[:200]
        raise _refused(
            path, "file", f"no YAML ({why})", "image, resolution and origin, as map_saver writes them"
        ) from exc
    if not isinstance(data, dict):
        raise _refused(path, "file", "no map", _SAVED)
    fields = cast("Mapping[str, object]", data)
    if faults := list(_description_faults(fields)):
        raise SourceError(faults, str(path))
    x_m, y_m, *turn = cast("list[float]", fields["origin"])
    return MapDescription(
        image=cast("str", fields["image"]),
        resolution_m=float(cast("float", fields["resolution"])),
        origin=(float(x_m), float(y_m), float(turn[0]) if turn else 0.0),
        negate=bool(fields.get("negate", 0)),
        occupied_above=float(cast("float", fields.get("occupied_thresh", _THRESHOLDS["occupied_thresh"]))),
        free_below=float(cast("float", fields.get("free_thresh", _THRESHOLDS["free_thresh"]))),
        mode=cast("Mode", fields.get("mode", "trinary")),
    ), body


def _description_faults(fields: Mapping[str, object]) -> Iterator[Fault]:
    """Yields what is wrong with a map's fields; of those that are left out, what map_server does without."""
    image, resolution, origin = fields.get("image"), fields.get("resolution"), fields.get("origin")
    if not isinstance(image, str) or not image:
        yield _fault("image", image, "the name of a picture (.pgm or .png) in the folder of this file")
    if not (is_number(resolution) and 0.001 <= resolution <= 10.0):
        yield _fault("resolution", resolution, "metres a cell, from 0.001 to 10")
    if not (isinstance(origin, list) and len(cast("list[object]", origin)) in (2, 3) and all(map(_is_place, origin))):
        yield _fault("origin", origin, "[x, y, yaw] of the lower left corner, in metres and rad, each within 100 km")
    if not (isinstance(fields.get("negate", 0), int) and fields.get("negate", 0) in (0, 1)):
        yield _fault("negate", fields["negate"], "0, or 1 where dark is free")
    if fields.get("mode", "trinary") not in ("trinary", "scale", "raw"):
        yield _fault("mode", fields["mode"], "trinary, scale or raw")
    thresholds = {
        "occupied_thresh": fields.get("occupied_thresh", _THRESHOLDS["occupied_thresh"]),
        "free_thresh": fields.get("free_thresh", _THRESHOLDS["free_thresh"]),
    }
    wrong = {name: value for name, value in thresholds.items() if not (is_number(value) and 0.0 <= value <= 1.0)}
    yield from (_fault(name, value, "from 0 to 1") for name, value in wrong.items())
    occupied, free = thresholds.values()
    if not wrong and cast("float", free) > cast("float", occupied):
        yield _fault("free_thresh", free, f"at most occupied_thresh, which is {occupied}")


def _fault(name: str, value: object, allowed: str) -> Fault:
    return Fault(path=name, value=_shown(value), allowed=allowed)


def _shown(value: object) -> str:
    """Returns what stands in a YAML file, in a few characters, however large it is."""
    if isinstance(value, list):
        few = [
            _shown(each) if isinstance(each, str | int | float) else "..." for each in cast("list[object]", value)[:4]
        ]
        return f"[{', '.join(few)}]"
    if value is None or (isinstance(value, int) and abs(value) > _MOST_WHOLE):
        return "nothing" if value is None else "a number beyond all bounds"
    return repr(value)[:80] if isinstance(value, str | int | float) else f"a {type(value).__name__}"


def is_number(value: object) -> TypeGuard[float]:
    """Returns whether what stands in a YAML file is a number that a computation can take."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= _MOST_WHOLE
    return isinstance(value, float) and math.isfinite(value)


def _is_place(value: object) -> bool:
    return is_number(value) and abs(value) <= 1e5


def _picture_path(path: Path, image: str) -> Path:
    """Returns where the picture is, which lies in the map's folder or below."""
    folder = path.parent.resolve()
    found = (folder / image).resolve()
    if not found.is_relative_to(folder):
        raise _refused(path, "image", repr(image), f"a picture in {folder} or below")
    if not found.is_file():
        raise _refused(path, "image", repr(image), f"a picture; there is no file {found}")
    return found


# The picture.


def _read_cells(path: Path, picture: Path, described: MapDescription) -> tuple[KnownCells, bytes]:
    """Returns what is known of each cell of a map's picture, and the picture's bytes."""
    with picture.open("rb") as file:
        body = file.read(_MOST_IMAGE_BYTES + 1)
    if len(body) > _MOST_IMAGE_BYTES:
        raise _refused(path, "image", f"{described.image!r}: more than 256 MB", "a smaller picture")
    try:
        shade, opaque, averaged = _shades(body)
    except (OSError, SyntaxError, ValueError, EOFError) as exc:
        why = " ".join(str(exc).split())[:200]
        allowed = f"a whole picture, PGM or PNG, of at most {MOST_PIXELS:,} pixels (4,096 x 4,096)"
        raise _refused(path, "image", f"{described.image!r}: {why}", allowed) from exc
    if described.mode == "raw":
        value = np.rint(shade * 255.0) / 100.0
        known = value <= 1.0
        cells = KnownCells(known & (value > described.occupied_above), known & (value < described.free_below))
    else:
        # What is transparent is a lighter cell to trinary, and an unknown one to scale.
        trinary = described.mode == "trinary"
        light = averaged if trinary else shade
        dark = light if described.negate else 1.0 - light
        seen = opaque | trinary
        cells = KnownCells(seen & (dark > described.occupied_above), seen & (dark < described.free_below))
    return KnownCells(cells.occupied[::-1], cells.free[::-1]), body


_Shades = Float[np.ndarray, "rows columns"]


def _shades(body: bytes) -> tuple[_Shades, Cells, _Shades]:
    """Returns how light each pixel is (0-1), which pixels are opaque, and the mean of colours and opacity.

    Raises:
        OSError: It is no whole picture; or SyntaxError, ValueError or EOFError, as Pillow has it.
    """
    from io import BytesIO  # noqa: PLC0415 - with the next

    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - where there is a map to read

    Image.MAX_IMAGE_PIXELS = None  # the size is looked at below, before any pixel is read
    try:
        opened = Image.open(BytesIO(body), formats=_FORMATS)
    except UnidentifiedImageError as exc:
        raise ValueError("another kind of file") from exc  # Pillow names an address in memory
    with opened as image:
        if image.width * image.height > MOST_PIXELS:
            raise ValueError(f"{image.width:,} x {image.height:,} pixels")
        image.load()
        channels, top = _channels(image)
    colours = channels.shape[2] - (channels.shape[2] + 1) % 2  # an even number of channels has opacity last
    shade = channels[..., :colours].sum(axis=2) / (colours * top)
    if colours == channels.shape[2]:
        return shade, np.ones(shade.shape, np.bool_), shade
    alpha = channels[..., -1] / top
    return shade, alpha >= 1.0, (3.0 * shade + alpha) / 4.0


def _channels(image: "Image") -> tuple[np.ndarray, int]:
    """Returns a picture's channels (rows, columns, channels), and the value of white."""
    if image.mode in _WIDE_MODES:
        return np.asarray(image)[..., None], 65535
    if image.mode == "1":
        image = image.convert("L")
    elif image.mode not in ("L", "LA", "RGB", "RGBA"):
        image = image.convert("RGBA" if image.has_transparency_data else "RGB")
    channels = np.asarray(image)
    return (channels[..., None] if channels.ndim == 2 else channels), 255


# The solids.


def _beside(cells: Cells) -> Cells:
    """Returns the cells that share a side with one of these."""
    found = np.zeros_like(cells)
    found[1:] |= cells[:-1]
    found[:-1] |= cells[1:]
    found[:, 1:] |= cells[:, :-1]
    found[:, :-1] |= cells[:, 1:]
    return found


def merged_cells(cells: Cells) -> list[tuple[int, int, int, int]]:
    """Returns rectangles that together are the cells: first and last column and row, the last ones not included.

    Equal runs of neighbouring rows are one rectangle; or of columns, if these are fewer. Of more than ``MOST_SOLIDS``
    only so many are found that this shows.
    """
    rows = _merged_runs(cells)
    columns = [(row, column, row_end, column_end) for column, row, column_end, row_end in _merged_runs(cells.T)]
    return rows if len(rows) <= len(columns) else columns


def _merged_runs(cells: Cells) -> list[tuple[int, int, int, int]]:
    open_runs: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for row, line in enumerate([*cells, np.zeros(cells.shape[1], np.bool_)]):
        if len(found) > MOST_SOLIDS:
            break
        borders = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]))).tolist()
        runs = set(zip(borders[::2], borders[1::2], strict=True))
        found += [(low, begun, high, row) for (low, high), begun in open_runs.items() if (low, high) not in runs]
        open_runs = {run: open_runs.get(run, row) for run in sorted(runs)}
    return sorted(found)


def _loose_blobs(cells: KnownCells, resolution_m: float) -> Int[np.ndarray, "rows columns"]:
    """Returns the number, from 1, of the thing standing free that each cell is of, with what it hides; 0 for the rest.

    What has floor all around and is 0.2 to 2.5 m long somebody may move, as a table or a pallet. A map does not say of
    a pillar that it is one.
    """
    from scipy import ndimage  # noqa: PLC0415 - where there is a map to read

    blobs, loose = np.zeros(cells.free.shape, np.int32), np.zeros(cells.free.shape, np.int32)
    ndimage.label(~cells.free, structure=np.ones((3, 3), dtype=np.bool_), output=blobs)
    outer = np.concatenate([blobs[0], blobs[-1], blobs[:, 0], blobs[:, -1]])
    fixed = np.bincount(blobs[cells.occupied], minlength=int(blobs.max()) + 1) == 0  # nobody saw anything there
    fixed[outer] = True
    count = 0
    for number, (rows, columns) in enumerate(ndimage.find_objects(blobs), start=1):
        length_m = resolution_m * max(rows.stop - rows.start, columns.stop - columns.start)
        if not fixed[number] and _LEAST_LOOSE_M <= length_m <= _MOST_LOOSE_M and count < _MOST_LOOSE:
            count += 1
            loose[rows, columns][blobs[rows, columns] == number] = count
    return loose


_Rectangles = Sequence[tuple[int, int, int, int]]


def _pieces(
    walls: _Rectangles,
    edges: _Rectangles,
    loose: Int[np.ndarray, "rows columns"],
    described: MapDescription,
    height_m: float,
) -> tuple[Furniture, ...]:
    """Returns the walls, each thing that stands free, and what stands for the end of the known floor.

    Args:
        walls: What is occupied.
        edges: The unknown cells that floor ends at.
        loose: The numbers of the things that stand free.
        described: What the YAML file says.
        height_m: How high everything stands.
    """
    found: dict[str, list[Solid]] = {}
    for name, rectangles, color in (("wall", walls, _GREY), ("edge", edges, _PAPER)):
        solids = _solids(name, rectangles, described, height_m, color)
        for (column, row, _, _), solid in zip(rectangles, solids, strict=True):
            blob = int(loose[row, column])
            piece = f"obstacle-{blob}" if blob else "walls" if name == "wall" else "edge-walls"
            found.setdefault(piece, []).append(solid)
    return tuple(_piece(name, tuple(found[name])) for name in sorted(found, key=_walls_first))


def _walls_first(piece: str) -> tuple[int, int]:
    """Returns the place of a piece in a world: walls, the end of the floor, then the others by their numbers."""
    order = ("walls", "edge-walls")
    return (order.index(piece), 0) if piece in order else (len(order), int(piece.rpartition("-")[2]))


def _solids(
    name: str,
    rectangles: Sequence[tuple[int, int, int, int]],
    described: MapDescription,
    height_m: float,
    color: tuple[float, float, float],
) -> tuple[Solid, ...]:
    """Returns upright boxes over rectangles of cells, turned as the map is."""
    cell_m, (x_m, y_m, turn) = described.resolution_m, described.origin
    cos, sin = math.cos(turn), math.sin(turn)
    found: list[Solid] = []
    for number, (low_x, low_y, high_x, high_y) in enumerate(rectangles, start=1):
        along, across = cell_m * (low_x + high_x) / 2, cell_m * (low_y + high_y) / 2
        found.append(
            Solid(
                name=f"{name}-{number}",
                shape="box",
                center_m=(
                    rounded(x_m + cos * along - sin * across),
                    rounded(y_m + sin * along + cos * across),
                    rounded(height_m / 2),
                ),
                half_extents_m=(
                    rounded(cell_m * (high_x - low_x) / 2 - _HAIR_M),
                    rounded(cell_m * (high_y - low_y) / 2 - _HAIR_M),
                    rounded(height_m / 2),
                ),
                yaw_rad=rounded(turn),
                color=color,
            )
        )
    return tuple(found)


def _piece(name: str, solids: tuple[Solid, ...]) -> Furniture:
    kind = "walls of a map" if "wall" in name else "obstacle of a map"
    return Furniture(name=name, model_type=kind, room="", center_m=solids[0].center_m[:2], yaw_rad=0.0, solids=solids)


def _edge_finding(edge: Cells, cells: KnownCells, described: MapDescription) -> Iterator[ImportFinding]:
    """Yields what is done where free floor ends at cells that nobody knows."""
    if edge.any():
        area_m2 = described.resolution_m**2 * int(np.count_nonzero(~cells.free & ~cells.occupied))
        yield ImportFinding(
            subject="unknown cells",
            became="approximated",
            why=f"{area_m2:.1f} m2 are neither free nor occupied, which is no floor: "
            f"where free floor ends at them, {int(edge.sum())} cells stand as walls",
            off_m=0.0,
        )
