"""One world as each format shows it, read back by that format's own library: docs/pictures/formats.jpg.

    .venv/bin/python -m benchmarks.export.format_pictures docs/pictures/formats.jpg

The world is cut open, written in each format, read by MuJoCo, ElementTree (SDF and OBJ), trimesh or OpenUSD, and what
they found is given to one renderer. A colour, a picture or a place that a format lost would be seen.
"""

import io
import math
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import trimesh
from PIL import Image, ImageDraw
from pxr import Usd, UsdGeom, UsdShade

from benchmarks.worlds.world_templates import read_template
from specs.data.world import World
from tasks.export.format.formats import format_files
from tasks.export.format.mjcf import GROUND
from tasks.export.picture.render_process import CUT_M, cut_open, photograph, whole_view
from tasks.worlds.generate import generate_world

WIDTH, HEIGHT, SAMPLES, SEED = 800, 560, 40, 3
Files = Mapping[str, bytes]


class Found:
    """What a reader found, as a model."""

    def __init__(self, world: World) -> None:
        """Begins with ground and sky."""
        self.spec = mujoco.MjSpec()
        area = world.footprint
        self.spec.stat.center = [(area.x_min_m + area.x_max_m) / 2, (area.y_min_m + area.y_max_m) / 2, 1.0]
        self.spec.stat.extent = math.hypot(area.x_max_m - area.x_min_m, area.y_max_m - area.y_min_m) / 2
        self.spec.visual.map.shadowscale = 1.0
        self.spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            width=8,
            height=48,
        )
        self.spec.worldbody.add_geom(
            name=GROUND,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            pos=[*self.spec.stat.center[:2], 0.0],
            size=[(area.x_max_m - area.x_min_m) / 2, (area.y_max_m - area.y_min_m) / 2, 1.0],
        )
        self._meshes = 0

    def solid(self, matrix: np.ndarray, *, cylinder: bool, half_m: np.ndarray, color: np.ndarray) -> None:
        """Adds a box or an upright cylinder with a colour of sRGB."""
        yaw_rad = math.atan2(matrix[1, 0], matrix[0, 0])
        self.spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
            pos=matrix[:3, 3],
            quat=[math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)],
            size=[half_m[0], half_m[2], 0.0] if cylinder else half_m,
            rgba=[*color, 1.0],
        )

    def mesh(
        self,
        corners: np.ndarray,
        triangles: np.ndarray,
        uv: np.ndarray | None,
        picture: bytes | None,
        color: np.ndarray,
    ) -> None:
        """Adds a mesh in the world's frame, with a picture or a colour."""
        self._meshes += 1
        name = f"mesh-{self._meshes}"
        mesh = self.spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert, mesh.userface = corners.astype(np.float32).ravel(), triangles.astype(np.int32).ravel()
        geom = self.spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=[*color, 1.0])
        geom.contype = geom.conaffinity = 0  # a flat mesh has no hull
        if picture is not None and uv is not None:
            mesh.usertexcoord = uv.astype(np.float32).ravel()
            self.spec.assets = {**self.spec.assets, f"{name}.png": picture}
            self.spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=f"{name}.png")
            material = self.spec.add_material(name=name, specular=0.1, shininess=0.1)
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
            geom.material, geom.rgba = name, [1.0, 1.0, 1.0, 1.0]


def from_mjcf(_world: World, files: Files, _folder: Path) -> mujoco.MjSpec:
    """Returns what MuJoCo reads."""
    (name,) = (name for name in files if name.endswith("world.xml"))
    place = name.removesuffix("world.xml")
    return mujoco.MjSpec.from_string(
        files[name].decode(), assets={path.removeprefix(place): body for path, body in files.items()}
    )


def from_sdf(world: World, _files: Files, folder: Path) -> mujoco.MjSpec:
    """Returns what stands in the SDF documents and their OBJ meshes."""
    found = Found(world)
    (file,) = folder.rglob("*.world")
    root = ET.parse(file).getroot()  # noqa: S314 - our own document
    for include in root.iter("include"):
        model = (include.findtext("uri") or "").removeprefix("model://")
        (source,) = folder.rglob(f"{model}/model.sdf")
        for visual in ET.parse(source).getroot().iter("visual"):  # noqa: S314 - same
            _visual(found, _pose(include) @ _pose(visual), visual, source.parent)
    for model in root.iterfind("world/model"):
        for visual in model.iter("visual"):
            _visual(found, _pose(model) @ _pose(visual), visual, file.parent)
    return found.spec


def _pose(element: ET.Element) -> np.ndarray:
    x, y, z, _, _, yaw = map(float, (element.findtext("pose") or "0 0 0 0 0 0").split())
    matrix = trimesh.transformations.rotation_matrix(yaw, (0, 0, 1))
    matrix[:3, 3] = x, y, z
    return matrix


def _visual(found: Found, matrix: np.ndarray, visual: ET.Element, folder: Path) -> None:
    color = np.array((visual.findtext("material/diffuse") or "1 1 1 1").split()[:3], float)
    if (size := visual.findtext("geometry/box/size")) is not None:
        found.solid(matrix, cylinder=False, half_m=np.array(size.split(), float) / 2, color=color)
    elif (radius := visual.findtext("geometry/cylinder/radius")) is not None:
        half_m = np.array([radius, radius, float(visual.findtext("geometry/cylinder/length") or 0) / 2], float)
        found.solid(matrix, cylinder=True, half_m=half_m, color=color)
    else:
        uri = (visual.findtext("geometry/mesh/uri") or "").partition("model://")[2].partition("/")[2]
        _obj(found, folder / uri)


def _obj(found: Found, file: Path) -> None:
    words = [line.split() for line in file.read_text().splitlines()]
    corners, uv = (np.array([word[1:] for word in words if word[0] == kind], float) for kind in ("v", "vt"))
    triangles = np.array([[int(c.split("/")[0]) - 1 for c in word[1:]] for word in words if word[0] == "f"])
    (used,) = (word[1] for word in words if word[0] == "usemtl")
    library = (file.parent / "finishes.mtl").read_text().partition(f"newmtl {used}\n")[2].partition("newmtl")[0]
    facts = {line.split()[0]: line.split()[1:] for line in library.splitlines() if line}
    picture = (file.parent / facts["map_Kd"][0]).read_bytes() if "map_Kd" in facts else None
    found.mesh(corners, triangles, uv, picture, np.array(facts["Kd"], float))


def from_glb(world: World, files: Files, _folder: Path) -> mujoco.MjSpec:
    """Returns what trimesh reads."""
    found = Found(world)
    scene = trimesh.load_scene(io.BytesIO(next(iter(files.values()))), file_type="glb")
    scene.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (1, 0, 0)))
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name].copy().apply_transform(matrix)
        material = mesh.visual.material
        picture = None
        if material.baseColorTexture is not None:
            body = io.BytesIO()
            material.baseColorTexture.convert("RGB").save(body, "PNG")
            picture = body.getvalue()
        color = np.ones(3) if picture else _srgb(np.array(material.baseColorFactor[:3]) / 255)
        # Boxes have a corner once; drawn flat, each face needs its own.
        corners = mesh.vertices[mesh.faces].reshape(-1, 3)
        uv = None if mesh.visual.uv is None else mesh.visual.uv[mesh.faces].reshape(-1, 2)
        found.mesh(corners, np.arange(len(corners)).reshape(-1, 3), uv, picture, color)
    return found.spec


def from_usd(world: World, _files: Files, folder: Path) -> mujoco.MjSpec:
    """Returns what OpenUSD reads."""
    found = Found(world)
    (file,) = folder.rglob("*.usda")
    stage = Usd.Stage.Open(str(file))
    places = UsdGeom.XformCache()
    for prim in stage.Traverse():
        matrix = np.array(places.GetLocalToWorldTransform(prim)).T
        if prim.GetTypeName() in {"Cube", "Cylinder", "Mesh"}:
            color, picture = _look(prim, file.parent)
            _prim(found, prim, matrix, color, picture)
    return found.spec


def _prim(found: Found, prim: Usd.Prim, matrix: np.ndarray, color: np.ndarray, picture: bytes | None) -> None:
    if prim.GetTypeName() == "Cube":
        half_m = np.linalg.norm(matrix[:3, :3], axis=0) * UsdGeom.Cube(prim).GetSizeAttr().Get() / 2
        found.solid(matrix, cylinder=False, half_m=half_m, color=color)
    elif prim.GetTypeName() == "Cylinder":
        drum = UsdGeom.Cylinder(prim)
        radius_m, height_m = drum.GetRadiusAttr().Get(), drum.GetHeightAttr().Get()
        found.solid(matrix, cylinder=True, half_m=np.array([radius_m, radius_m, height_m / 2]), color=color)
    else:
        mesh = UsdGeom.Mesh(prim)
        uv = np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("st").Get())
        triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        found.mesh(np.array(mesh.GetPointsAttr().Get()), triangles, uv, picture, color)


def _look(prim: Usd.Prim, folder: Path) -> tuple[np.ndarray, bytes | None]:
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    surface, _, _ = material.ComputeSurfaceSource()
    base = surface.GetInput("diffuseColor")
    source = base.GetConnectedSources()[0]
    if not source:
        return _srgb(np.array(base.Get())), None
    picture = UsdShade.Shader(source[0].source).GetInput("file").Get()
    return np.ones(3), (folder / picture.path).read_bytes()


def _srgb(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


READERS: Mapping[str, tuple[str, Callable[[World, Files, Path], mujoco.MjSpec]]] = {
    "mjcf": ("mjcf, read by MuJoCo", from_mjcf),
    "sdf": ("sdf with OBJ, read as XML", from_sdf),
    "glb": ("glb, read by trimesh", from_glb),
    "usd": ("usd, read by OpenUSD", from_usd),
}


def main(target: Path) -> None:
    """Renders and writes the picture."""
    template = read_template("two-rooms")
    world = generate_world(template, seed=SEED, generation="wgj-1", floorplan_index=1, interior_index=1)
    opened, view = cut_open(world, CUT_M), whole_view(world, WIDTH / HEIGHT)
    context = mujoco.GLContext(WIDTH, HEIGHT)
    context.make_current()
    page = Image.new("RGB", (2 * WIDTH, 2 * HEIGHT), "white")
    for number, (name, (caption, read)) in enumerate(READERS.items()):
        with tempfile.TemporaryDirectory() as folder:
            files = format_files(opened, name)  # pyright: ignore[reportArgumentType] - a format
            for path, body in files.items():
                (Path(folder) / path).parent.mkdir(parents=True, exist_ok=True)
                (Path(folder) / path).write_bytes(body)
            spec = read(opened, files, Path(folder))
        picture = Image.fromarray(photograph(spec, view, WIDTH, HEIGHT, SAMPLES))
        ImageDraw.Draw(picture).text((16, 12), caption, fill=(40, 44, 48), font_size=22)
        page.paste(picture, (number % 2 * WIDTH, number // 2 * HEIGHT))
    page.save(target, quality=85)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
