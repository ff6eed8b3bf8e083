"""The formats of an export: one record each, with a pure function from a world to its files by path in the zip.

All are in metres and radians with z up and the origin where the robot starts; GLB, whose y is up by definition, turns
that in its root node. What writes a format is imported when it is asked for: two need libraries that not everybody has.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Callable, Collection, Mapping
from importlib.util import find_spec
from pathlib import PurePosixPath
from typing import NamedTuple

from specs.base import Fault, canonical_document, canonical_json
from specs.data.world import World
from specs.errors import DocumentError
from specs.pipeline.world_sections import WorldFormat
from tasks.storage.base.keys import checked_name

SOURCE_FOLDER = "workspace_src/src"
Writer = Callable[[World], Mapping[str, bytes]]


class ExportFormat(NamedTuple):
    """One format.

    Attributes:
        name: What a document calls it.
        opened_by: What opens its files, as docs/guide/export.md says.
        files: What a world becomes, by path in the format's folder; the same bytes for the same world.
        folder: Its folder in the zip; empty for one of its own name.
        needs: Modules that must be installed; ``pip install 'simyard[<name>]'`` brings them.
        shared_files: What goes once into a zip, from the generation and the name of its first world.
    """

    name: WorldFormat
    opened_by: str
    files: Writer
    folder: str = ""
    needs: tuple[str, ...] = ()
    shared_files: Callable[[str, str], Mapping[str, bytes]] | None = None

    def in_zip(self, files: Mapping[str, bytes]) -> dict[str, bytes]:
        """Returns files of the format by their paths in the zip."""
        return {f"{self.folder or self.name}/{path}": body for path, body in files.items()}

    def is_installed(self) -> bool:
        """Returns whether the format can be written here."""
        return all(find_spec(module) is not None for module in self.needs)


def format_files(world: World, name: WorldFormat) -> dict[str, bytes]:
    """Returns what a world becomes in one format, by path in the zip; the same bytes for the same world.

    Raises:
        DocumentError: The world's name or generation may not stand in a path.
    """
    return EXPORT_FORMATS[name].in_zip(EXPORT_FORMATS[name].files(world))


def require_writable(formats: Collection[WorldFormat], source: str, path: str = "formats") -> None:
    """Refuses formats whose writers are not installed here; ``path`` is where the document has them.

    Raises:
        DocumentError: Some are not; says what to install.
    """
    missing = [name for name in sorted(set(formats)) if not EXPORT_FORMATS[name].is_installed()]
    if missing:
        faults = [
            Fault(path=path, value=name, allowed=f"a format that is installed: pip install 'simyard[{name}]'")
            for name in missing
        ]
        raise DocumentError(faults, source=source)


def _place(world: World) -> PurePosixPath:
    return PurePosixPath(checked_name(world.generation, "generation")) / checked_name(world.name, "world")


def _in_folder(world: World, files: Mapping[str, bytes]) -> dict[str, bytes]:
    return {f"{_place(world)}/{path}": body for path, body in files.items()}


def _world(world: World) -> Mapping[str, bytes]:
    return {f"{_place(world)}.json": canonical_json(canonical_document(world))}


def _sdf(world: World) -> Mapping[str, bytes]:
    from tasks.export.format.sdf import sdf_files

    _place(world)
    return sdf_files(world)


def _ros_packages(generation: str, world: str) -> Mapping[str, bytes]:
    from tasks.export.format.ros_packages import package_files
    from tasks.export.format.sdf import workspace_name

    return package_files(workspace_name(generation, world))


def _mjcf(world: World) -> Mapping[str, bytes]:
    from tasks.export.format.mjcf import mjcf_files

    return _in_folder(world, mjcf_files(world))


def _map(world: World) -> Mapping[str, bytes]:
    from tasks.export.format.occupancy_map import map_files

    return _in_folder(world, map_files(world))


def _svg(world: World) -> Mapping[str, bytes]:
    from tasks.export.drawing.floor_plan import floor_plan_svg

    return {f"{_place(world)}.svg": floor_plan_svg(world).encode()}


def _glb(world: World) -> Mapping[str, bytes]:
    from tasks.export.format.glb import glb

    return {f"{_place(world)}.glb": glb(world)}


def _usd(world: World) -> Mapping[str, bytes]:
    from tasks.export.format.usd import usd_files

    return _in_folder(world, usd_files(world))


_RECORDS = (
    ExportFormat("world", "Simyard itself", _world),
    ExportFormat("sdf", "Gazebo", _sdf, folder=SOURCE_FOLDER, shared_files=_ros_packages),
    ExportFormat("mjcf", "MuJoCo", _mjcf),
    ExportFormat("map", "Nav2 and ROS map_server", _map),
    ExportFormat("svg", "a browser", _svg),
    ExportFormat("glb", "web pages, Blender", _glb, needs=("trimesh", "PIL")),
    ExportFormat("usd", "Isaac Sim, usdview", _usd, needs=("pxr",)),
)
EXPORT_FORMATS: Mapping[WorldFormat, ExportFormat] = {each.name: each for each in _RECORDS}
"""By name, in the order in which their files stand in a zip."""
