"""Windows as boxes that are seen and not touched: a pane and its frame on either face of the wall."""

from typing import Literal

from specs.data.world import Color, Room, Solid, Window, World
from tasks.export.surface.skins import SKIN_LIFT_M, Side, windows_of

WINDOW_PREFIX = "window/"

_FRAME_M, _FRAME_DEPTH_M = 0.05, 0.02
_PANE_COLOR: Color = (0.72, 0.84, 0.93)
_FRAME_COLOR: Color = (0.95, 0.95, 0.94)


def window_parts(world: World, room: Room) -> list[Solid]:
    """Returns the panes and bars of a room's windows, named ``window/<room>/<number>/<in or out>/<part>``."""
    parts: list[Solid] = []
    for number, (side, window) in enumerate(windows_of(world, room), start=1):
        outside = Side(side.along, side.at_m - side.inwards * world.wall_thickness_m, _opposite(side), 0.0, 0.0)
        for face, where in ((side, "in"), (outside, "out")):
            parts += _on_face(face, window, f"{WINDOW_PREFIX}{room.name}/{number}/{where}")
    return parts


def _opposite(side: Side) -> Literal[1, -1]:
    return -1 if side.inwards == 1 else 1


def _on_face(face: Side, window: Window, name: str) -> list[Solid]:
    middle_m = window.center_m[0] if window.along == "x" else window.center_m[1]
    half_m, height_m = window.width_m / 2, (window.top_m + window.bottom_m) / 2
    tall_m, bar_m = (window.top_m - window.bottom_m) / 2, _FRAME_M / 2
    return [
        _part(face, f"{name}/{part}", (along_m, z_m), (half_along_m, half_up_m), is_pane=part == "pane")
        for part, along_m, z_m, half_along_m, half_up_m in (
            ("pane", middle_m, height_m, half_m, tall_m),
            ("sill", middle_m, window.bottom_m + bar_m, half_m, bar_m),
            ("head", middle_m, window.top_m - bar_m, half_m, bar_m),
            ("first", middle_m - half_m + bar_m, height_m, bar_m, tall_m - 2 * bar_m),
            ("last", middle_m + half_m - bar_m, height_m, bar_m, tall_m - 2 * bar_m),
            ("mullion", middle_m, height_m, bar_m, tall_m - 2 * bar_m),
        )
    ]


def _part(face: Side, name: str, middle_m: tuple[float, float], half_m: tuple[float, float], *, is_pane: bool) -> Solid:
    """Returns a box on a face of a wall, its middle and half sizes given along the wall and up."""
    depth_m = SKIN_LIFT_M if is_pane else _FRAME_DEPTH_M
    x_m, y_m = face.point_m(middle_m[0], depth_m / 2)
    flat_m = (half_m[0], depth_m / 2) if face.along == "x" else (depth_m / 2, half_m[0])
    return Solid(
        name=name,
        shape="box",
        center_m=(x_m, y_m, middle_m[1]),
        half_extents_m=(*flat_m, half_m[1]),
        yaw_rad=0.0,
        color=_PANE_COLOR if is_pane else _FRAME_COLOR,
    )
