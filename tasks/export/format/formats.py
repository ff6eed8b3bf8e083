"""The formats, each a pure function of a world: the files that it becomes, by their paths in the zip.

    mjcf           mjcf/<generation>/<world>/world.xml and textures                  MuJoCo
    sdf            workspace_src/src/..., RoboMaker's layout                         Gazebo
    map            map/<generation>/<world>/map.yaml and map.pgm                     Nav2, ROS map_server
    svg            svg/<generation>/<world>.svg                                      a browser
    world          world/<generation>/<world>.json, the world itself
    glb            glb/<generation>/<world>.glb                                      web pages, Blender
    usd            usd/<generation>/<world>/world.usda and textures                  Isaac Sim, usdview

All are in metres and radians with z up and the origin where the robot starts; GLB, whose y is up by definition, turns
that in its root node.
"""

from collections.abc import Callable, Mapping
from pathlib import PurePosixPath

from specs.data.world import World
from specs.digest import canonical_document, canonical_json
from specs.pipeline.world_sections import WorldFormat
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.export.format.mjcf import mjcf_files
from tasks.export.format.occupancy_map import map_files
from tasks.export.format.sdf import sdf_files
from tasks.storage.base.keys import checked_name

SOURCE_FOLDER = "workspace_src/src"
Writer = Callable[[World], Mapping[str, bytes]]


def format_files(world: World, name: WorldFormat) -> dict[str, bytes]:
    """Returns what a world becomes in one format, by path in the zip; the same bytes for the same world.

    Raises:
        DocumentError: The world's name or generation may not stand in a path.
    """
    return {f"{name if name != 'sdf' else SOURCE_FOLDER}/{path}": body for path, body in _WRITERS[name](world).items()}


def _place(world: World) -> PurePosixPath:
    return PurePosixPath(checked_name(world.generation, "generation")) / checked_name(world.name, "world")


def _in_folder(files: Callable[[World], Mapping[str, bytes]]) -> Writer:
    return lambda world: {f"{_place(world)}/{path}": body for path, body in files(world).items()}


def _as_file(suffix: str, body: Callable[[World], bytes]) -> Writer:
    return lambda world: {f"{_place(world)}{suffix}": body(world)}


def _document(world: World) -> bytes:
    return canonical_json(canonical_document(world))


def _svg(world: World) -> bytes:
    return floor_plan_svg(world).encode()


def _sdf(world: World) -> Mapping[str, bytes]:
    _place(world)
    return sdf_files(world)


def _glb(world: World) -> bytes:
    from tasks.export.format.glb import glb  # noqa: PLC0415 - an extra, which need not be there

    return glb(world)


def _usd(world: World) -> Mapping[str, bytes]:
    from tasks.export.format.usd import usd_files  # noqa: PLC0415 - same

    return usd_files(world)


_WRITERS: Mapping[WorldFormat, Writer] = {
    "mjcf": _in_folder(mjcf_files),
    "sdf": _sdf,
    "map": _in_folder(map_files),
    "svg": _as_file(".svg", _svg),
    "world": _as_file(".json", _document),
    "glb": _as_file(".glb", _glb),
    "usd": _in_folder(_usd),
}
