"""One world, many formats, one geometry: rays meet the same things in each."""

import io
import json
import math
from typing import cast

import mujoco
import numpy as np
import pytest
import trimesh
from jaxtyping import Bool, Float64
from PIL import Image
from scipy import ndimage

from specs.data.world import World, solids
from specs.template.body import TemplateBody
from tasks.export.format.glb import glb
from tasks.export.format.mjcf import world_spec
from tasks.export.format.occupancy_map import FREE, PICTURE_FILE, map_files
from tasks.worlds.generate import generate_world
from tests.repository import ROOT
from tests.worlds.geometry_checks import distances, in_the_way

pytestmark = pytest.mark.long

TEMPLATES = (
    ROOT / "examples/templates/two-rooms.json",
    ROOT / "benchmarks/templates/one-bedroom-house.json",
)
HEADROOM_M = 2.0  # what a map shows (specs.data.world.OccupancyMap)
RAYS = 64
FAR_M = 60.0


SEEDS_OF_WORLDS_WITH_DOORS = range(14, 20)


def template(seed: int) -> TemplateBody:
    """Returns one of the templates; for some seeds with a door, anyhow open, in every doorway (version 2)."""
    document = json.loads(TEMPLATES[seed % 2].read_text())
    if seed in SEEDS_OF_WORLDS_WITH_DOORS:
        ajar = {
            "Name": "ajar",
            "TargetSet": "Target.All",
            "Door": {"InitialState": {"OpenPosition": {"Percent": "Random"}}},
        }
        document["Version"] = "2"
        for floor in (floor for building in document["Buildings"] for floor in building["Floors"]):
            floor["Interior"] = floor.get("Interior", {}) | {"Doorways": {"DoorwaySets": [ajar]}}
    return TemplateBody.model_validate(document)


@pytest.fixture(scope="module", params=range(20))
def world(request: pytest.FixtureRequest) -> World:
    seed: int = request.param
    found = generate_world(template(seed), seed=seed, generation="wgj-1", floorplan_index=1, interior_index=1)
    assert bool(found.doors) == (seed in SEEDS_OF_WORLDS_WITH_DOORS)
    return found


def directions() -> Float64[np.ndarray, "rays 3"]:
    angles = np.linspace(0, 2 * np.pi, RAYS, endpoint=False) + 0.01
    return np.stack([np.cos(angles), np.sin(angles), np.zeros(RAYS)], axis=1)


def heights(world: World) -> list[float]:
    """Returns heights at which every solid below head height is met by one of them."""
    middles = {
        (max(0.0, z - half) + min(HEADROOM_M, z + half)) / 2
        for z, half in ((solid.center_m[2], solid.half_extents_m[2]) for solid in solids(world))
        if z - half < HEADROOM_M
    }
    return sorted(round(middle, 3) for middle in middles)


def load(world: World) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Returns the world in MuJoCo; what only shows floorings, wall coverings and windows is no obstacle to rays."""
    model = world_spec(world).compile()
    model.geom_group[:] = np.where((model.geom_contype | model.geom_conaffinity) > 0, 0, 5)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def in_mujoco(loaded: tuple[mujoco.MjModel, mujoco.MjData], height_m: float) -> Float64[np.ndarray, "rays"]:
    """Returns how far rays from above the origin come among what collides."""
    model, data = loaded
    groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    met, distances = np.zeros(RAYS, np.int32), np.zeros(RAYS)
    origin = np.array([0.0, 0.0, height_m])
    mujoco.mj_multiRay(model, data, origin, directions().ravel(), groups, 1, -1, met, distances, None, RAYS, FAR_M)
    return np.where(distances >= 0, distances, FAR_M)


def solids_of_glb(world: World) -> trimesh.Trimesh:
    """Returns the meshes of the solids as one, in the world's frame."""
    scene = trimesh.load_scene(io.BytesIO(glb(world)), file_type="glb")
    scene.apply_transform(np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]))
    parts: list[trimesh.Trimesh] = []
    for solid in solids(world):
        matrix, geometry = scene.graph[solid.name]
        parts.append(scene.geometry[geometry].copy().apply_transform(matrix))
    return cast("trimesh.Trimesh", trimesh.util.concatenate(parts))


def in_glb(mesh: trimesh.Trimesh, height_m: float) -> Float64[np.ndarray, "rays"]:
    """Returns the same among the meshes of the solids."""
    origins = np.tile([0.0, 0.0, height_m], (RAYS, 1))
    places, rays, _ = mesh.ray.intersects_location(origins, directions())
    found = np.full(RAYS, FAR_M)
    np.minimum.at(found, rays, np.hypot(*places[:, :2].T))
    return found


def in_map(world: World) -> Float64[np.ndarray, "rays"]:
    """Returns how far one comes from the origin over cells that are not occupied, by small steps."""
    picture = np.asarray(Image.open(io.BytesIO(map_files(world)[PICTURE_FILE])))[::-1]
    steps_m = np.arange(0.0, FAR_M, world.map.resolution_m / 20)
    places = directions()[:, None, :2] * steps_m[:, None]
    cells = np.floor((places - np.array(world.map.origin_m)) / world.map.resolution_m).astype(int)
    rows, columns = cells[..., 1].clip(0, world.map.rows - 1), cells[..., 0].clip(0, world.map.columns - 1)
    return steps_m[np.argmax(picture[rows, columns] == 0, axis=1)]


def test_rays_meet_the_same_in_mujoco_and_in_the_glb(world: World):
    mesh, loaded = solids_of_glb(world), load(world)
    for height_m in (0.1037, 0.4037, 1.1037):  # no surface lies there
        np.testing.assert_allclose(in_glb(mesh, height_m), in_mujoco(loaded, height_m), atol=0.01)


def test_rays_meet_the_doors_where_there_are_any(world: World):
    with_doors, without = load(world), load(world.model_copy(update={"doors": ()}))
    differs_m = np.abs(in_mujoco(with_doors, 1.1037) - in_mujoco(without, 1.1037))
    assert bool(world.doors) == bool(np.any(differs_m > 0.01))


def footprints(world: World) -> Float64[np.ndarray, "solids 4"]:
    """Returns what solids below head height cover on the floor, unturned: (x min, y min, x max, y max)."""
    found: list[list[float]] = []
    for solid in solids(world):
        if solid.center_m[2] - solid.half_extents_m[2] < HEADROOM_M:
            cos, sin = abs(np.cos(solid.yaw_rad)), abs(np.sin(solid.yaw_rad))
            (x_m, y_m, _), (center_x_m, center_y_m, _) = solid.half_extents_m, solid.center_m
            half_x_m, half_y_m = cos * x_m + sin * y_m, sin * x_m + cos * y_m
            found.append([center_x_m - half_x_m, center_y_m - half_y_m, center_x_m + half_x_m, center_y_m + half_y_m])
    return np.array(found)


def test_a_ray_in_the_map_ends_where_the_first_solid_does_or_within_a_cell_of_one(world: World):
    loaded = load(world)
    nearest_m = np.min([in_mujoco(loaded, height_m) for height_m in heights(world)], axis=0)
    mapped_m = in_map(world)
    assert np.max(mapped_m - nearest_m) < world.map.resolution_m
    ends = directions()[:, :2] * mapped_m[:, None]
    boxes = footprints(world)
    away = np.maximum(boxes[:, :2] - ends[:, None], ends[:, None] - boxes[:, 2:]).clip(0).max(2).min(1)
    assert away.max() <= world.map.resolution_m


def certified_floor(world: World, grown_m: float) -> Bool[np.ndarray, "rows columns"]:
    """Returns the cells whose middles lie in a room or a passage, free of grown solids, connected to the origin."""
    cell_m, origin_m = world.map.resolution_m, world.map.origin_m
    x_m, y_m = np.meshgrid(
        origin_m[0] + cell_m * (np.arange(world.map.columns) + 0.5),
        origin_m[1] + cell_m * (np.arange(world.map.rows) + 0.5),
    )

    def within(low_x_m: float, low_y_m: float, high_x_m: float, high_y_m: float) -> Bool[np.ndarray, "rows columns"]:
        return (x_m > low_x_m) & (x_m < high_x_m) & (y_m > low_y_m) & (y_m < high_y_m)

    floor = np.zeros(x_m.shape, bool)
    for room in world.rooms:
        floor |= within(room.floor.x_min_m, room.floor.y_min_m, room.floor.x_max_m, room.floor.y_max_m)
    for passage in world.passages:
        half = (passage.width_m / 2, world.wall_thickness_m / 2 + cell_m)
        half_x_m, half_y_m = half if passage.along == "x" else half[::-1]
        x, y = passage.center_m
        floor |= within(x - half_x_m, y - half_y_m, x + half_x_m, y + half_y_m)
    points = np.stack([x_m, y_m], axis=-1).reshape(-1, 2)
    for solid in in_the_way(world):
        floor &= (distances(solid, points) > grown_m).reshape(floor.shape)
    return connected(floor, world)


def connected(cells: Bool[np.ndarray, "rows columns"], world: World) -> Bool[np.ndarray, "rows columns"]:
    """Returns those of the cells that one gets to from the origin."""
    regions, _ = cast("tuple[np.ndarray, int]", ndimage.label(cells))
    column, row = (int(-start_m / world.map.resolution_m) for start_m in world.map.origin_m)
    return regions == regions[row, column]


def grown(cells: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    """Returns the cells and their eight neighbours."""
    return np.asarray(ndimage.binary_dilation(cells, np.ones((3, 3), bool)), bool)


def test_the_free_cells_are_the_floor_that_is_reached_within_a_cell(world: World):
    free = np.asarray(Image.open(io.BytesIO(map_files(world)[PICTURE_FILE])))[::-1] == FREE
    assert not np.any(free & ~grown(certified_floor(world, 0.0)))
    # A leg thinner than a cell hides no cell's middle, and stands in the way all the same.
    untouched = certified_floor(world, world.map.resolution_m * math.sqrt(0.5))
    assert not np.any(connected(~grown(~untouched), world) & ~free)
