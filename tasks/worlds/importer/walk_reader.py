"""Files of positions with times become walks that people of an episode do again.

A CSV or Parquet file has the columns ``person``, ``t_s``, ``x_m`` and ``y_m``, a row for each place where somebody was,
in any order; other columns are left out.
"""

import csv
import hashlib
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from specs.base import Fault
from specs.data.world import MOST_WALK_PLACES, RecordedWalk
from tasks.worlds.geometry import rounded
from tasks.worlds.importer.source_files import file_body, refused_file
from tasks.worlds.importer.source_scene import SourceError

WALK_FILES = (".csv", ".parquet")
"""How the names of such files end."""

_COLUMNS = ("person", "t_s", "x_m", "y_m")
_MOST_BYTES = 16 << 20
_MOST_WALKS = 100
_FARTHEST = 1e5
_NUMBERS = f"a time of 0 to {_FARTHEST:,.0f} s and a place within {_FARTHEST:,.0f} m"


class Walked(NamedTuple):
    """How people walked.

    Attributes:
        walks: In the order of their files, and of their first rows.
        files: SHA-256 of each file that was read, by its name.
    """

    walks: tuple[RecordedWalk, ...]
    files: Mapping[str, str]


def read_walks(paths: Sequence[Path]) -> Walked:
    """Returns the walks of files.

    Raises:
        SourceError: One of them is no file of positions, or two have the same person; carries all faults.
    """
    found, files, faults = dict[str, RecordedWalk](), dict[str, str](), list[Fault]()
    for number, path in enumerate(paths):
        try:
            body = file_body(path, _MOST_BYTES, "positions")
            files[f"walks/{number}/{path.name}"] = hashlib.sha256(body).hexdigest()
            for each in _walks(path, body):
                if each.name in found:
                    faults.append(Fault(path=path.name, value=each.name, allowed="a person that no other file has"))
                found[each.name] = each
        except SourceError as exc:
            faults += exc.faults
    if len(found) > _MOST_WALKS:
        faults.append(Fault(path="routes", value=f"{len(found)} people", allowed=f"at most {_MOST_WALKS}"))
    if faults:
        raise SourceError(faults, "routes")
    return Walked(tuple(found.values()), files)


def _walks(path: Path, body: bytes) -> list[RecordedWalk]:
    """Returns the walks of a file; who is at two places at one time is at the later row's."""
    places: dict[str, dict[float, tuple[float, float]]] = {}
    for number, row in enumerate(_rows(path, body), start=1):
        person, *numbers = (row[name] for name in _COLUMNS)
        try:
            t_s, x_m, y_m = (float(str(each)) for each in numbers)
        except ValueError:
            t_s = x_m = y_m = math.nan
        name = str(person).strip()
        if not (0.0 <= t_s <= _FARTHEST and abs(x_m) <= _FARTHEST and abs(y_m) <= _FARTHEST):
            raise refused_file(path, f"row {number}", repr(numbers), _NUMBERS)
        if not 0 < len(name) <= 64 or not name.isprintable():
            raise refused_file(path, f"row {number}", repr(person), "a person's name of 1 to 64 letters, or a number")
        places.setdefault(name, {})[rounded(t_s)] = (rounded(x_m), rounded(y_m))
    if not places:
        raise refused_file(path, "", "no row", "a row for each place")
    for name, own in places.items():
        if len(own) > MOST_WALK_PLACES:
            raise refused_file(path, name, f"{len(own):,} places", f"at most {MOST_WALK_PLACES:,}")
    return [
        RecordedWalk(name=name, times_s=tuple(sorted(own)), points_m=tuple(own[at_s] for at_s in sorted(own)))
        for name, own in places.items()
    ]


def _rows(path: Path, body: bytes) -> Sequence[Mapping[str, object]]:
    if path.suffix.lower() == ".parquet":
        import pyarrow as pa  # noqa: PLC0415 - the other sources need none of it
        import pyarrow.parquet as pq  # noqa: PLC0415 - likewise

        try:
            rows: Sequence[Mapping[str, object]] = pq.read_table(io.BytesIO(body)).to_pylist()
        except pa.ArrowException as exc:
            raise refused_file(path, "", f"no Parquet ({exc})", "a Parquet file") from exc
    else:
        try:
            rows = list(csv.DictReader(io.StringIO(body.decode("utf-8-sig"))))
        except (UnicodeDecodeError, csv.Error) as exc:
            raise refused_file(path, "", f"no CSV ({exc})", "a CSV file in UTF-8") from exc
    lacking = [name for name in _COLUMNS if rows and name not in rows[0]]
    if lacking:
        raise refused_file(path, "", f"no column {', '.join(lacking)}", f"columns {', '.join(_COLUMNS)}")
    return rows
