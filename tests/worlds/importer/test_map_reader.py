"""Maps of ROS as scenes: each cell where it was, in every mode and picture that map_server loads, and broken ones."""

import contextlib
import io
import math
import os
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from specs.data.world import Solid
from tasks.worlds.importer.map_reader import merged_cells, read_map
from tasks.worlds.importer.source_scene import Scene, SourceError
from tests.factories.ros_maps import HALL, levels, pgm, write_map

UNKNOWN_CORNER = (
    "#######",
    "#.....#",
    "#.. ...",
    "#######",
)


def solids(scene: Scene) -> list[Solid]:
    return [solid for piece in scene.pieces for solid in piece.solids]


def drawn(scene: Scene, size: tuple[int, int]) -> np.ndarray:
    """Returns which pixels of a map that is not turned lie under a solid, the upper row first."""
    columns, rows = size
    found = np.zeros((rows, columns), np.bool_)
    for solid in solids(scene):
        (x, y, _), (half_x, half_y, _) = solid.center_m, solid.half_extents_m
        low_x, high_x = (round((edge - 1.0) / 0.05) for edge in (x - half_x, x + half_x))
        low_y, high_y = (round((edge - 2.0) / 0.05) for edge in (y - half_y, y + half_y))
        found[low_y:high_y, low_x:high_x] = True
    return found[::-1]


def is_hall(scene: Scene) -> bool:
    return bool((drawn(scene, (10, 6)) == (levels(HALL) == 0)).all())


def png(pixels: np.ndarray) -> bytes:
    body = io.BytesIO()
    Image.fromarray(pixels).save(body, format="PNG")
    return body.getvalue()


def test_each_occupied_cell_stands_where_it_was(tmp_path: Path) -> None:
    scene = read_map(write_map(tmp_path), 2.5)
    assert is_hall(scene)
    assert {solid.center_m[2] + solid.half_extents_m[2] for solid in solids(scene)} == {2.5}
    assert (scene.parts, scene.exact, scene.findings) == (32, 32, ())
    assert sorted(scene.files) == ["map.pgm", "map.yaml"]


def test_a_turned_map_turns_about_its_corner(tmp_path: Path) -> None:
    path = write_map(tmp_path, ("#.",), origin=[1.0, 2.0, math.pi / 2])
    solid = solids(read_map(path))[0]
    assert solid.center_m[:2] == pytest.approx((1.0 - 0.025, 2.0 + 0.025), abs=1e-5)
    assert solid.yaw_rad == pytest.approx(math.pi / 2, abs=1e-6)


def _plain_pgm() -> bytes:
    rows = "\n".join(" ".join(map(str, row)) for row in levels(HALL).tolist())
    return f"P2\n# by hand\n10 6\n# 255 is white\n255\n{rows}\n".encode()


def _wide_pgm() -> bytes:
    return b"P5\n10 6\n65535\n" + (levels(HALL).astype(">u2") * 257).tobytes()


def _coloured(alpha: bool) -> np.ndarray:  # noqa: FBT001 - which picture
    grey = np.repeat(levels(HALL)[..., None], 3, axis=2)
    return np.concatenate([grey, np.full((6, 10, 1), 255, np.uint8)], axis=2) if alpha else grey


@pytest.mark.parametrize(
    ("image", "body"),
    [
        ("map.pgm", pgm(levels(HALL), "# CREATOR: map_saver 0.050 m/pix\n")),
        ("map.pgm", _plain_pgm()),
        ("map.pgm", _wide_pgm()),
        ("map.png", pgm(levels(HALL))),
        ("map.png", png(levels(HALL))),
        ("map.png", png(levels(HALL).astype(np.uint16) * 257)),
        ("map.png", png(_coloured(alpha=False))),
        ("map.png", png(_coloured(alpha=True))),
        ("map.png", png(levels(HALL) > 0)),
    ],
    ids=["comment", "plain", "16-bit", "pgm-named-png", "grey", "grey-16-bit", "rgb", "rgba", "bits"],
)
def test_each_form_of_picture_is_the_same_map(tmp_path: Path, image: str, body: bytes) -> None:
    assert is_hall(read_map(write_map(tmp_path, image=image, body=body)))


def test_negate_turns_light_and_dark(tmp_path: Path) -> None:
    assert is_hall(read_map(write_map(tmp_path, body=pgm(255 - levels(HALL)), negate=1)))


def test_raw_cells_are_per_cent(tmp_path: Path) -> None:
    per_cent = np.where(levels(HALL) == 0, 100, 0)
    assert is_hall(read_map(write_map(tmp_path, body=pgm(per_cent), mode="raw", negate=1)))


def test_transparent_cells_are_unknown_to_scale_alone(tmp_path: Path) -> None:
    pixels = _coloured(alpha=True)
    pixels[2:4, 3:5, 3] = 254  # the pillar in the hall
    body = png(pixels)
    scaled = read_map(write_map(tmp_path, image="map.png", body=body, mode="scale"))
    assert scaled.parts == 28
    assert read_map(write_map(tmp_path, image="map.png", body=body)).parts == 32


def test_where_free_floor_ends_at_unknown_cells_these_stand(tmp_path: Path) -> None:
    scene = read_map(write_map(tmp_path, UNKNOWN_CORNER))
    assert drawn(scene, (7, 4))[2].tolist() == [True, False, False, True, False, False, False]
    (finding,) = scene.findings
    assert (finding.subject, finding.became) == ("unknown cells", "approximated")
    assert "1 cells stand as walls" in finding.why
    assert [piece.name for piece in scene.pieces] == ["walls", "edge-walls"]


def test_what_stands_free_is_a_piece_of_its_own_with_what_it_hides(tmp_path: Path) -> None:
    yard = "#" + "." * 70 + "#"
    table = "#...#####" + "." * 62 + "#"
    hollow = "#...#   #" + "." * 62 + "#"
    behind = "#" + "." * 30 + " ##" + "." * 37 + "#"
    leg, long, patch = "#..." + "###" + "." * 64 + "#", "#.." + "#" * 51 + "." * 17 + "#", "#...     " + "." * 62 + "#"
    rows = ("#" * 72, yard, table, hollow, table, yard, behind, behind, behind, behind, yard, leg, yard, long, yard)
    scene = read_map(write_map(tmp_path, (*rows, patch, yard, "#" * 72)))
    assert [piece.name for piece in scene.pieces] == ["walls", "edge-walls", "obstacle-1", "obstacle-2"]
    assert {piece.name: piece.model_type for piece in scene.pieces}["obstacle-1"] == "obstacle of a map"
    widths = {
        piece.name: round(
            max(s.center_m[0] + s.half_extents_m[0] for s in piece.solids)
            - min(s.center_m[0] - s.half_extents_m[0] for s in piece.solids),
            2,
        )
        for piece in scene.pieces
    }
    assert widths == {"walls": 3.6, "edge-walls": 0.25, "obstacle-1": 0.15, "obstacle-2": 0.25}


def test_a_cell_between_the_thresholds_is_unknown(tmp_path: Path) -> None:
    path = write_map(tmp_path, UNKNOWN_CORNER, free_thresh=0.2)
    assert not read_map(path).findings, "205 is darker than 0.196 and lighter than 0.2"


@given(st.integers(1, 12), st.integers(1, 12), st.randoms(use_true_random=False))
def test_rectangles_are_the_cells_and_do_not_overlap(columns: int, rows: int, draw: "np.random.Generator") -> None:
    cells = np.array([[draw.random() < 0.5 for _ in range(columns)] for _ in range(rows)])
    count = np.zeros((rows, columns), int)
    for low_x, low_y, high_x, high_y in merged_cells(cells):
        count[low_y:high_y, low_x:high_x] += 1
    assert (count == cells).all()


HUGE = b"P5\n20000 20000\n255\n"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"body": b""}, "image: 'map.pgm': a picture; there is no file"),
        ({"body": pgm(levels(HALL))[:-7]}, "image: 'map.pgm': "),
        ({"body": b"\xff\xd8\xff\xe0JFIF"}, "image: 'map.pgm': another kind of file: a whole picture, PGM or PNG"),
        ({"body": HUGE}, "image: 'map.pgm': 20,000 x 20,000 pixels: a whole picture"),
        ({"body": b"GIF89a"}, "image: 'map.pgm': "),
        ({"image": "../map.pgm", "body": b""}, "image: '../map.pgm': a picture in "),
        ({"resolution": -0.05}, "resolution: -0.05: metres a cell, from 0.001 to 10"),
        ({"resolution": ".nan"}, "resolution: nan: metres a cell"),
        ({"resolution": None}, "resolution: nothing: metres a cell"),
        ({"origin": "[.inf, 0, 0]"}, "origin: [inf, 0, 0]: [x, y, yaw]"),
        ({"origin": [1.0]}, "origin: [1.0]: [x, y, yaw]"),
        ({"mode": "grey"}, "mode: 'grey': trinary, scale or raw"),
        ({"negate": 2}, "negate: 2: 0, or 1 where dark is free"),
        ({"occupied_thresh": 65}, "occupied_thresh: 65: from 0 to 1"),
        ({"free_thresh": 0.8}, "free_thresh: 0.8: at most occupied_thresh, which is 0.65"),
        ({"negate": 1, "rows": ("...",)}, "map.pgm: no cell is free: a picture with floor: see negate and free_thresh"),
    ],
)
def test_what_is_wrong_with_a_map_is_named(tmp_path: Path, fields: dict[str, object], said: str) -> None:
    with pytest.raises(SourceError) as caught:
        read_map(write_map(tmp_path, **fields))  # type: ignore[arg-type]
    assert said in str(caught.value)


def test_all_faults_of_the_description_are_told_at_once(tmp_path: Path) -> None:
    path = write_map(tmp_path, resolution=0, origin="here", mode="none")
    with pytest.raises(SourceError) as caught:
        read_map(path)
    assert [fault.path for fault in caught.value.faults] == ["resolution", "origin", "mode"]


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "image: *x", "[" * 5000, "\x00", "x" * 70_000])
def test_what_is_no_yaml_of_a_map_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(SourceError, match="image, resolution and origin"):
        read_map(tmp_path / "map.yaml")


ALIASES = "".join(f"{chr(98 + n)}: &{chr(98 + n)} [{','.join(['*' + chr(97 + n)] * 9)}]\n" for n in range(9))


@pytest.mark.parametrize("value", ["*j", f"0x{'f' * 8_000}", f"[0x{'f' * 900}, 0, 0]", "{a: *j}", "!!set {a, b}"])
def test_values_that_would_fill_the_memory_are_told_in_a_few_characters(tmp_path: Path, value: str) -> None:
    names = ("image", "resolution", "origin", "negate", "mode", "free_thresh")
    text = f"a: &a [x]\n{ALIASES}" + "".join(f"{name}: {value}\n" for name in names)
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(SourceError) as caught:
        read_map(tmp_path / "map.yaml")
    assert {fault.path for fault in caught.value.faults} == set(names)
    assert all(len(fault.value) <= 100 for fault in caught.value.faults)


def test_a_map_of_noise_is_refused_before_it_is_solids(tmp_path: Path) -> None:
    noise = (np.indices((300, 300)).sum(axis=0) % 2 * 254).astype(np.uint8)
    with pytest.raises(SourceError, match="at most 20,000 rectangles: clear it of noise"):
        read_map(write_map(tmp_path, body=pgm(noise)))


def test_a_picture_that_a_link_leads_to_elsewhere_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    path = write_map(folder, body=b"")
    (tmp_path / "other.pgm").write_bytes(pgm(levels(HALL)))
    (folder / "map.pgm").symlink_to(tmp_path / "other.pgm")
    with pytest.raises(SourceError, match=r"a picture in .*maps or below"):
        read_map(path)


def test_a_pipe_is_no_picture(tmp_path: Path) -> None:
    path = write_map(tmp_path, body=b"")
    os.mkfifo(tmp_path / "map.pgm")
    with pytest.raises(SourceError, match="there is no file"):
        read_map(path)


@pytest.mark.parametrize("seed", range(4))
def test_files_with_wrong_bytes_are_refused_or_read(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)  # noqa: S311 - draws wrong bytes
    bodies = [pgm(levels(HALL)), _plain_pgm(), _wide_pgm(), png(levels(HALL)), png(_coloured(alpha=True))]
    for _ in range(60):
        path = write_map(tmp_path, body=draw.choice(bodies), mode=draw.choice(["trinary", "scale", "raw"]))
        victim = draw.choice([path, tmp_path / "map.pgm"])
        body = bytearray(victim.read_bytes())
        for _ in range(draw.choice([1, 2, 8])):
            place = draw.randrange(len(body))
            body[place : place + draw.choice([0, 1, 4])] = draw.randbytes(draw.choice([0, 1, 4]))
        victim.write_bytes(body)
        with contextlib.suppress(SourceError):
            assert solids(read_map(path))
