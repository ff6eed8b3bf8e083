"""Coverings of floors and walls as Wavefront OBJ, which both generations of Gazebo read."""

from collections.abc import Sequence

from specs.data.world import Finish
from tasks.export.surface.sheets import Covering, finish_key
from tasks.export.surface.textures import texture_of

MATERIALS_FILE = "finishes.mtl"


def obj(sheet: Covering) -> bytes:
    """Returns a sheet's corners and triangles."""
    lines = [f"mtllib {MATERIALS_FILE}", "o sheet", f"usemtl {finish_key(sheet.finish)}"]
    lines += [f"v {x_m:.6f} {y_m:.6f} {z_m:.6f}" for x_m, y_m, z_m in sheet.vertices_m.tolist()]
    lines += [f"vt {along:.6f} {up:.6f}" for along, up in sheet.coordinates.tolist()]
    for triangle in (sheet.triangles + 1).tolist():
        lines.append("f " + " ".join(f"{corner}/{corner}" for corner in triangle))
    return ("\n".join(lines) + "\n").encode()


def materials(finishes: Sequence[Finish]) -> dict[str, bytes]:
    """Returns the material library of some finishes, and the pictures that it names, beside it."""
    files: dict[str, bytes] = {}
    lines: list[str] = []
    for finish in finishes:
        key = finish_key(finish)
        lines += [f"newmtl {key}", "Ns 10", "Ks 0.05 0.05 0.05"]
        texture = texture_of(finish)
        if texture is None:
            channels = " ".join(f"{channel:.6f}" for channel in finish.color)
            lines += [f"Ka {channels}", f"Kd {channels}"]
        else:
            files[f"{key}.png"] = texture.png
            lines += ["Ka 1 1 1", "Kd 1 1 1", f"map_Kd {key}.png"]
    return {MATERIALS_FILE: ("\n".join(lines) + "\n").encode(), **files}
