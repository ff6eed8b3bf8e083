"""Gazebo's own library takes every file, and finds in them what the world says."""

import math
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from jaxtyping import Float64

from specs.data.world import Door, World, solids
from tasks.export.format.ros_packages import package_files
from tasks.export.format.sdf import MODELS_PACKAGE, WORLDS_PACKAGE, numbers_text, obj, sdf_files, sdf_name
from tasks.render.sheets import FLOOR_PREFIX, Covering, sheets
from tasks.render.textures import texture_of
from tests.export.validators import sdf_says
from tests.export.variants import DOOR, HINGE_M, other_hand, with_door, with_windows
from tests.factories.worlds import apartment

WORLD = with_windows(with_door(30.0))


def unpacked(world: World, folder: Path) -> Path:
    """Writes a world's files below a folder, and returns that of the world itself."""
    for path, body in {**sdf_files(world), **package_files(sdf_name(world))}.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(body)
    return folder / f"{WORLDS_PACKAGE}/worlds/{sdf_name(world)}/{sdf_name(world)}.world"


def models(folder: Path) -> tuple[Path, Path]:
    return folder / f"{MODELS_PACKAGE}/models", folder / f"{WORLDS_PACKAGE}/models"


def poses(element: ET.Element) -> np.ndarray:
    """Returns an element's pose as a matrix of the plane, its height apart: (cos, -sin, x), (sin, cos, y), z."""
    x, y, z, _, _, yaw = map(float, (element.findtext("pose") or "0 0 0 0 0 0").split())
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def test_libsdformat_takes_the_world_and_every_model(tmp_path: Path):
    file = unpacked(WORLD, tmp_path)
    files = [file, *(path for folder in models(tmp_path) for path in folder.glob("*/model.sdf"))]
    assert len(files) == 2 + len(WORLD.furniture)
    assert {sdf_says(each, models(tmp_path)) for each in files} == {"Valid."}


def test_libsdformat_refuses_a_broken_one(tmp_path: Path):
    file = unpacked(WORLD, tmp_path)
    file.write_text(file.read_text().replace('type="revolute"', 'type="sideways"'))
    assert "sideways" in sdf_says(file, models(tmp_path))


def test_every_solid_stands_where_the_world_says(tmp_path: Path):
    root = ET.parse(unpacked(WORLD, tmp_path)).getroot()  # noqa: S314 - our own document
    found: dict[str, tuple[np.ndarray, str]] = {}
    for include in root.iter("include"):
        model = (include.findtext("uri") or "").removeprefix("model://")
        piece = include.findtext("name") or ""
        (file,) = tmp_path.glob(f"*/models/{model}/model.sdf")
        for collision in ET.parse(file).getroot().iter("collision"):  # noqa: S314 - same
            name = collision.attrib["name"].removesuffix("_collision")
            name = name if piece == "building" else f"{piece}/{name}"
            found[name] = (poses(include) @ poses(collision), ET.tostring(collision, "unicode"))
    leaf = root.find(f"world/model[@name='{DOOR}']")
    assert leaf is not None
    (collision,) = leaf.iter("collision")
    found[DOOR] = (poses(leaf) @ poses(collision), ET.tostring(collision, "unicode"))
    for solid in solids(WORLD):
        matrix, shape = found[solid.name]
        np.testing.assert_allclose(matrix[:3, 3], solid.center_m, atol=2e-5)
        size = numbers_text(2 * side for side in solid.half_extents_m)
        if solid.shape == "box":
            assert f"<size>{size}</size>" in shape
            turn = math.atan2(matrix[1, 0], matrix[0, 0]) - solid.yaw_rad
            assert math.remainder(turn, math.pi) == pytest.approx(0.0, abs=2e-5)
        else:
            assert f"<radius>{numbers_text([solid.half_extents_m[0]])}</radius>" in shape


def test_a_door_turns_about_its_hinge_from_shut_to_a_quarter_turn(tmp_path: Path):
    root = ET.parse(unpacked(WORLD, tmp_path)).getroot()  # noqa: S314 - same
    model = root.find(f"world/model[@name='{DOOR}']")
    assert model is not None
    assert poses(model)[:2, 3] == pytest.approx(HINGE_M)
    low, high = (float(model.findtext(f"joint/axis/limit/{end}") or "nan") for end in ("lower", "upper"))
    assert (low, high) == pytest.approx((-0.3 * math.pi / 2, 0.7 * math.pi / 2), abs=1e-5)
    assert float(model.findtext("link/inertial/mass") or 0) == pytest.approx(8 * 0.44 * 0.02 * 1.01 * 300)


@pytest.mark.parametrize("door", [WORLD.doors[0], other_hand(WORLD.doors[0])], ids=["clockwise", "anticlockwise"])
def test_a_door_turned_to_its_limits_is_shut_and_open(tmp_path: Path, door: Door):
    world = WORLD.model_copy(update={"doors": (door,)})
    root = ET.parse(unpacked(world, tmp_path)).getroot()  # noqa: S314 - same
    model = root.find(f"world/model[@name='{DOOR}']")
    assert model is not None
    x, y, upwards = map(float, (model.findtext("joint/axis/xyz") or "").split())
    assert (x, y) == (0.0, 0.0)
    stands_rad = math.atan2(poses(model)[1, 0], poses(model)[0, 0])
    turns_rad = [float(model.findtext(f"joint/axis/limit/{end}") or "nan") for end in ("lower", "upper")]
    shut_rad, open_rad = (stands_rad + upwards * turn_rad for turn_rad in turns_rad)
    assert math.remainder(shut_rad - door.closed_yaw_rad, 2 * math.pi) == pytest.approx(0.0, abs=2e-5)
    assert math.remainder(open_rad - door.open_yaw_rad, 2 * math.pi) == pytest.approx(0.0, abs=2e-5)


def test_pieces_of_one_make_share_a_model_wherever_they_stand():
    piece = apartment().furniture[0]
    moved = [
        solid.model_copy(
            update={
                "name": solid.name.replace(piece.name, "other-7"),
                "center_m": (solid.center_m[0] + 1.5, solid.center_m[1] + 0.25, solid.center_m[2]),
            }
        )
        for solid in piece.solids
    ]
    twin = piece.model_copy(
        update={"name": "other-7", "center_m": (piece.center_m[0] + 1.5, piece.center_m[1] + 0.25), "solids": moved}
    )
    world = apartment().model_copy(update={"furniture": (piece, twin)})
    assert len({path.split("/")[2] for path in sdf_files(world) if path.startswith(MODELS_PACKAGE)}) == 1


def test_only_a_world_with_doors_has_a_description_beside_it():
    names = [{path.rsplit("/", 1)[1] for path in sdf_files(world)} for world in (apartment(), WORLD)]
    assert ["world_description.json" in each for each in names] == [False, True]


def test_floors_and_walls_have_their_pictures_beside_their_meshes(tmp_path: Path):
    unpacked(WORLD, tmp_path)
    (folder,) = tmp_path.glob(f"{WORLDS_PACKAGE}/models/*/meshes")
    library = (folder / "finishes.mtl").read_text()
    used = {
        line.split()[1] for mesh in folder.glob("*.obj") for line in mesh.read_text().splitlines() if "usemtl" in line
    }
    assert used == {line.split()[1] for line in library.splitlines() if line.startswith("newmtl")}
    pictures = {line.split()[1] for line in library.splitlines() if line.startswith("map_Kd")}
    assert pictures == {path.name for path in folder.glob("*.png")} != set()


def test_both_generations_of_ros_find_packages_and_a_launch_file(tmp_path: Path):
    unpacked(WORLD, tmp_path)
    for package in (WORLDS_PACKAGE, MODELS_PACKAGE):
        root = ET.parse(tmp_path / package / "package.xml").getroot()  # noqa: S314 - same
        assert root.findtext("name") == package
        assert "catkin" in (tmp_path / package / "CMakeLists.txt").read_text()
    launch = ET.parse(tmp_path / WORLDS_PACKAGE / "launch/world.launch").getroot()  # noqa: S314 - same
    assert launch.find("arg[@name='world']") is not None
    compile((tmp_path / WORLDS_PACKAGE / "launch/world.launch.py").read_text(), "world.launch.py", "exec")


COVERED = apartment()
SHEETS = [sheet for sheet in sheets(COVERED) if texture_of(sheet.finish)]


def values(sheet: Covering, keyword: str) -> Float64[np.ndarray, "lines values"]:
    """Returns the numbers of all lines that begin with the keyword."""
    lines = [line.split() for line in obj(sheet).decode().splitlines()]
    return np.array([[float(word) for word in words[1:]] for words in lines if words[0] == keyword])


def faces(sheet: Covering) -> list[list[tuple[int, int]]]:
    """Returns for each triangle which corner, and which place in the picture, each of its corners is."""
    lines = [line.split() for line in obj(sheet).decode().splitlines()]
    pairs = [[word.split("/") for word in words[1:]] for words in lines if words[0] == "f"]
    return [[(int(corner) - 1, int(place) - 1) for corner, place in triangle] for triangle in pairs]


@pytest.mark.parametrize("sheet", SHEETS, ids=lambda sheet: sheet.name)
def test_triangles_are_the_sheets_in_its_order_of_corners(sheet: Covering):
    np.testing.assert_allclose(values(sheet, "v"), sheet.vertices_m, atol=1e-6)
    assert faces(sheet) == [[(corner, corner) for corner in triangle] for triangle in sheet.triangles.tolist()]


@pytest.mark.parametrize("sheet", SHEETS, ids=lambda sheet: sheet.name)
def test_pictures_stand_upright_and_have_their_size(sheet: Covering):
    texture = texture_of(sheet.finish)
    assert texture is not None
    corners, along_and_up = values(sheet, "v"), values(sheet, "vt") * texture.extent_m
    if sheet.name.startswith(FLOOR_PREFIX):
        np.testing.assert_allclose(along_and_up, corners[:, :2] - corners[:, :2].min(axis=0), atol=2e-5)
    else:
        np.testing.assert_allclose(along_and_up[:, 1], corners[:, 2], atol=2e-5)
