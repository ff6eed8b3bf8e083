"""The map that Nav2 loads is the floor of the world, the right way up."""

import io

import numpy as np
import yaml
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from specs.data.world import OccupancyMap, World, start_pose
from tasks.export.format.occupancy_map import FREE, MAP_FILE, OCCUPIED, PICTURE_FILE, UNKNOWN, map_files, map_levels
from tests.factories.worlds import apartment

#    x 0 1 2 3 4          a wall between x 3 and 4 at the top keeps nothing away, one cell at the right is closed in
ROWS = ("#####", "#...#", "#o#.#", "###x#", "#####")  # from the highest y down; o: origin, x: closed in below


def world_of(rows: tuple[str, ...], cell_m: float = 0.5) -> World:
    """Returns a world whose map is drawn with # for occupied and o for the origin's cell."""
    upwards = rows[::-1]
    cells = "".join("1" if cell == "#" else "0" for row in upwards for cell in row)
    runs, now, length = [], "0", 0
    for cell in cells:
        if cell != now:
            runs.append(length)
            now, length = cell, 0
        length += 1
    runs.append(length)
    row = next(number for number, line in enumerate(upwards) if "o" in line)
    origin = (-cell_m * (upwards[row].index("o") + 0.5), -cell_m * (row + 0.5))
    grid = OccupancyMap(resolution_m=cell_m, origin_m=origin, columns=len(rows[0]), rows=len(rows), runs=tuple(runs))
    return apartment().model_copy(update={"map": grid})


def loaded(world: World) -> tuple[dict[str, object], np.ndarray]:
    """Returns the description and the shares of black, as map_server reads them, the lowest y first."""
    files = map_files(world)
    description = yaml.safe_load(files[MAP_FILE])
    picture = np.asarray(Image.open(io.BytesIO(files[str(description["image"])])))
    return description, (255.0 - picture[::-1]) / 255.0


def test_map_server_sees_what_is_free_what_is_occupied_and_what_nobody_can_have_seen():
    description, black = loaded(world_of(("#####", "#...#", "#o#.#", "#####", "#x###")))
    seen = np.where(
        black > float(str(description["occupied_thresh"])),
        "#",
        np.where(black < float(str(description["free_thresh"])), ".", "?"),
    )
    assert ["".join(row) for row in seen[::-1]] == ["#####", "#...#", "#.#.#", "#####", "#?###"]


def test_the_description_places_the_picture_in_the_world():
    world = world_of(ROWS)
    description, _ = loaded(world)
    assert description == {
        "image": PICTURE_FILE,
        "mode": "trinary",
        "resolution": 0.5,
        "origin": [-0.75, -1.25, 0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }


@given(st.lists(st.text("#.", min_size=7, max_size=7), min_size=3, max_size=9))
def test_cells_keep_their_places_whatever_the_floor_is_like(rows: list[str]):
    rows[1] = rows[1][:3] + "o" + rows[1][4:]
    world = world_of(tuple(rows))
    levels = map_levels(world.map, start_pose(world))
    for row, line in zip(levels[::-1], rows, strict=True):
        assert [level == OCCUPIED for level in row] == [cell == "#" for cell in line]
        assert set(np.unique(row)) <= {FREE, UNKNOWN, OCCUPIED}
