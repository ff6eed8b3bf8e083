"""Parts of a source where they stand become a scene: the floor is found, pieces made, and all that is lost is told."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from specs.data.world import OVERHEAD_M, Color, Furniture, ImportFinding, Light, RecordedWalk, Solid, Start
from tasks.worlds.geometry import rounded
from tasks.worlds.importer.source_files import SourceFiles
from tasks.worlds.importer.source_scene import Scene
from tasks.worlds.importer.triangle_mesh import Pose, TriangleMesh
from tasks.worlds.importer.upright_solids import TOLERANCE_M, Fit, Upright, upright_solids

Corners = Float[np.ndarray, "faces 3 3"]
EXACT_M = 1e-3
"""Surfaces that moved less than this are where they were."""
FLAT_M = 0.03
"""What is no higher than this above the floor, a robot drives over: carpets, markings, the floor itself."""
FAR_M = 1e4
PLAIN: Color = (0.62, 0.62, 0.6)
_LEVEL_M = 0.01
_STEP_M = 0.5
_SHARE = 0.3
_LEVEL_FACE = 0.999
_FLAT_SHARE = 0.25
_STRAIGHT = 2e-3
YARD_M = 20.0
"""Of a side of the yard that stands for a plane without end; RoboMaker's first samples drive some metres."""
_YARD_WALL_M = (0.05, 0.5)  # half its thickness, half its height
_LEAST_HALF_M = 1e-3


class Placed(NamedTuple):
    """One part of a source that a robot could meet.

    Attributes:
        piece: The name of its model in the world: what moves together.
        subject: What it is called in the source, such as ``table/link/collision``.
        shape: What it is, for a person, such as ``a box``.
        mesh: Its surface, about its own origin.
        pose: Where its origin is.
        color: Its colour, where the source says one.
        upright: The cylinder that it is exactly while it stands upright (radius, height); else none.
        ball_m: The radius of a ball; else none.
    """

    piece: str
    subject: str
    shape: str
    mesh: TriangleMesh
    pose: Pose
    color: Color | None = None
    upright: tuple[float, float] | None = None
    ball_m: float | None = None


class Model(NamedTuple):
    """A model of the source.

    Attributes:
        name: Its name in the world, unique.
        kind: What it is a copy of.
        pose: Where it stands.
    """

    name: str
    kind: str
    pose: Pose


@dataclass
class Found:
    """What a reader found.

    Attributes:
        models: The models, in order.
        parts: What a robot could meet.
        planes_m: Heights of level planes without end.
        lights: Positions.
        start: Where a robot starts.
        findings: What is not in the parts.
        walks: How people walk.
    """

    models: list[Model] = field(default_factory=list)
    parts: list[Placed] = field(default_factory=list)
    planes_m: list[float] = field(default_factory=list)
    lights: list[tuple[float, float, float]] = field(default_factory=list)
    start: Start | None = None
    findings: list[ImportFinding] = field(default_factory=list)
    walks: list[RecordedWalk] = field(default_factory=list)

    def note(self, subject: str, became: str, why: str, off_m: float | None = None) -> None:
        """Notes what became of something, once."""
        found = ImportFinding.model_validate({"subject": subject, "became": became, "why": why, "off_m": off_m})
        self.findings.append(found)


def scene_of(
    found: Found, files: SourceFiles, start: tuple[float, float] | None = None, tolerance_m: float = TOLERANCE_M
) -> Scene:
    """Returns the scene of what a reader found.

    Args:
        found: What it found.
        files: What it read.
        start: Where a robot starts: what is there is the floor, if it is no further up than a step from what would be.
        tolerance_m: How far surfaces may move.

    Raises:
        SourceError: With the faults that were noted, or because nothing stands in the source.
    """
    files.check()
    _drop_what_is_far(found)
    if not found.parts and found.planes_m:
        return _scene(found, files, max(found.planes_m), (_yard(found),))
    if not found.parts:
        why = "; ".join(f"{each.subject}: {each.why}" for each in found.findings[:5])
        raise files.refuse("world", why or "nothing that a robot could meet", "at least one part with a collision")
    corners = [_points(part)[part.mesh.faces] for part in found.parts]
    floor_m = _floor(corners, sorted(found.planes_m))
    if start is not None:
        floor_m = _below(np.concatenate(corners), start, floor_m)
    if abs(floor_m) > 1e-6:
        found.note("floor", "approximated", f"lies {floor_m:g} m high in the source; everything is lower by that")
    maker = _Pieces(found, floor_m, tolerance_m)
    pieces = maker.made()
    if not pieces:
        raise files.refuse("world", "nothing but floor", f"at least one part higher than {FLAT_M:g} m above the floor")
    return _scene(found, files, floor_m, pieces, (maker.parts, maker.exact))


def _scene(
    found: Found, files: SourceFiles, floor_m: float, pieces: tuple[Furniture, ...], counts: tuple[int, int] = (0, 0)
) -> Scene:
    """Returns a scene whose pieces stand on the floor; its counts are those of the parts, and of the exact ones."""
    parts, exact = counts
    lights = tuple(Light(position_m=(rounded(x), rounded(y), rounded(z - floor_m))) for x, y, z in found.lights)
    return Scene(
        pieces=pieces,
        lights=lights,
        start=found.start,
        parts=parts,
        exact=exact,
        findings=tuple(found.findings),
        files=dict(sorted(files.digests.items())),
        walks=tuple(found.walks),
        floor_m=rounded(floor_m),
    )


def _yard(found: Found) -> Furniture:
    """Returns the wall around the origin of a plane without end on which nothing stands."""
    why = f"a plane without end, and nothing on it: a yard of {YARD_M:g} x {YARD_M:g} m with a wall around"
    found.note("floor", "approximated", why)
    half_m, (thick_m, up_m) = YARD_M / 2, _YARD_WALL_M
    sides = (
        ("yard_wall_east", (half_m, 0.0), (thick_m, half_m)),
        ("yard_wall_north", (0.0, half_m), (half_m + thick_m, thick_m)),
        ("yard_wall_west", (-half_m, 0.0), (thick_m, half_m)),
        ("yard_wall_south", (0.0, -half_m), (half_m + thick_m, thick_m)),
    )
    solids = tuple(
        Solid(name=name, shape="box", center_m=(*at, up_m), half_extents_m=(*half, up_m), yaw_rad=0.0, color=PLAIN)
        for name, at, half in sides
    )
    return Furniture(name="yard_wall", model_type="wall", room="", center_m=(0.0, 0.0), yaw_rad=0.0, solids=solids)


def _drop_what_is_far(found: Found) -> None:
    """Leaves out what stands where nobody put it on purpose."""
    near: list[Placed] = []
    for part in found.parts:
        far_m = float(np.abs(_points(part)[part.mesh.faces]).max())
        if far_m > FAR_M:
            found.note(part.subject, "dropped", f"stands {far_m:,.0f} m from the origin; {FAR_M:,.0f} m are the most")
        else:
            near.append(part)
    found.parts = near


def _points(part: Placed) -> Float[np.ndarray, "points 3"]:
    return part.mesh.points @ part.pose[:3, :3].T + part.pose[:3, 3]


def _below(corners: Corners, start: tuple[float, float], floor_m: float) -> float:
    """Returns the height of what a robot stands on at its start; the floor's, if nothing else is near that."""
    to = np.array(start) - corners[:, :, :2]
    sides = np.roll(corners, -1, axis=1)[:, :, :2] - corners[:, :, :2]
    turn = sides[:, :, 0] * to[:, :, 1] - sides[:, :, 1] * to[:, :, 0]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    over = ((turn >= 0.0).all(axis=1) | (turn <= 0.0).all(axis=1)) & (np.abs(normal[:, 2]) > 1e-9)
    slope = -normal[over][:, :2] / normal[over][:, 2:]
    first = corners[over][:, 0]
    height = first[:, 2] + (slope * (np.array(start) - first[:, :2])).sum(axis=1)
    near = height[np.abs(height - floor_m) <= _STEP_M]
    return float(near.max()) if len(near) else floor_m


def _floor(parts: Sequence[Corners], planes: Sequence[float]) -> float:
    """Returns the floor's height: of the level faces that cover most, the highest that is not far above the lowest.

    So a slab's top is the floor and not its bottom, a floor that lies on a plane is, and neither tables nor roofs are.
    A part's face is none that is high above its lowest corner for the part's width: a box's top is no floor.
    """
    corners = np.concatenate(parts)
    boxes = [(each.min((0, 1)), each.max((0, 1))) for each in parts]
    counts = [len(each) for each in parts]
    most = np.repeat([low[2] + _FLAT_SHARE * (high - low)[:2].min() for low, high in boxes], counts)
    thin = np.repeat([high[2] - low[2] <= _FLAT_SHARE * (high - low)[:2].min() for low, high in boxes], counts)
    low_enough = corners[:, :, 2].max(axis=1) <= most
    spread = float(np.prod(np.ptp(corners[:, :, :2].reshape(-1, 2), axis=0)))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    # Faces that look up; where nobody cared which way they look, those of thin parts that look down, too.
    for up, fit in ((normal[:, 2], low_enough), (np.abs(normal[:, 2]), thin)):
        level = (up > _LEVEL_FACE * length) & fit
        height, area = corners[level][:, :, 2].mean(axis=1), up[level] / 2
        levels, of = np.unique(np.round(height / _LEVEL_M), return_inverse=True)
        total = np.bincount(of.reshape(-1), weights=area, minlength=len(levels))
        wide = np.flatnonzero(total >= _SHARE * spread)
        if len(wide) or planes:
            break
    else:
        return 0.0
    lowest = min([*(float(levels[k] * _LEVEL_M) for k in wide), *planes])
    near = [k for k in wide if levels[k] * _LEVEL_M <= lowest + _STEP_M]
    tops = [each for each in planes if each <= lowest + _STEP_M]
    if near:
        here = of.reshape(-1) == near[-1]
        tops.append(float(np.average(height[here], weights=area[here])))
    return max(tops)


class _Pieces:
    """Pieces of parts, made one after the other; a mesh that stands there many times is looked at once."""

    def __init__(self, found: Found, floor_m: float, tolerance_m: float) -> None:
        self._found, self._floor_m, self._tolerance_m = found, floor_m, tolerance_m
        self._fits: dict[tuple[object, ...], Fit] = {}
        self.parts, self.exact = 0, 0

    def made(self) -> tuple[Furniture, ...]:
        """Returns the pieces, each with at least one solid."""
        by_piece: dict[str, list[Placed]] = {}
        for part in self._found.parts:
            by_piece.setdefault(part.piece, []).append(part)
        pieces: list[Furniture] = []
        for model in self._found.models:
            solids: list[Solid] = []
            for part in by_piece.get(model.name, ()):
                solids += [
                    self._named(f"{model.name}_{len(solids) + k}", part, each) for k, each in enumerate(self._of(part))
                ]
            if solids:
                x, y, _ = model.pose[:3, 3]
                yaw, _ = _yaw_and_tilt(model.pose[:3, :3])
                pieces.append(
                    Furniture(
                        name=model.name,
                        model_type=model.kind,
                        room="",
                        center_m=(rounded(x), rounded(y)),
                        yaw_rad=rounded(yaw),
                        solids=tuple(solids),
                    )
                )
        return tuple(pieces)

    def _named(self, name: str, part: Placed, solid: Upright) -> Solid:
        half_x, half_y, half_z = (rounded(max(each, _LEAST_HALF_M)) for each in solid.half_m)
        if solid.outline_m:  # which tells how wide it is
            half_x, half_y = map(rounded, solid.half_m[:2])
        x, y, z = map(rounded, solid.center_m)
        outline = solid.outline_m and tuple((rounded(px), rounded(py)) for px, py in solid.outline_m)
        return Solid(
            name=name,
            shape=solid.shape,
            center_m=(x, y, z),
            half_extents_m=(half_x, half_y, half_z),
            yaw_rad=rounded(solid.yaw_rad),
            color=part.color or part.mesh.color or PLAIN,
            outline_m=outline,
        )

    def _of(self, part: Placed) -> list[Upright]:
        """Returns the solids of a part; none for what a robot drives over, or what lies below the floor."""
        top = float(_points(part)[np.unique(part.mesh.faces), 2].max()) - self._floor_m
        if top <= FLAT_M:
            return []
        self.parts += 1
        yaw, tilt = _yaw_and_tilt(part.pose[:3, :3])
        x, y, z = part.pose[:3, 3]
        z -= self._floor_m
        ball = None if part.ball_m is None else _around_ball(part.ball_m, float(z))
        fit = ball or self._cylinder(part, tilt, z) or self._fit(part, tilt, z)
        if not fit.solids:
            self._found.note(part.subject, "dropped", f"{part.shape} without extent")
            return []
        if fit.off_m <= EXACT_M:
            self.exact += 1
        else:
            stack = f"{part.shape} of {len(part.mesh.faces):,} triangles as {len(fit.solids)} upright solids"
            why = f"{part.shape} as the cylinder around it" if ball else stack
            self._found.note(part.subject, "approximated", why, off_m=round(fit.off_m, 4))
        return [_turned(each, yaw, float(x), float(y)) for each in fit.solids if _stands_up(each)]

    def _cylinder(self, part: Placed, tilt: Float[np.ndarray, "3 3"], z: float) -> Fit | None:
        if part.upright is None or abs(abs(tilt[2, 2]) - 1.0) > 1e-6:
            return None
        radius, height = part.upright
        low, high = max(z - height / 2, 0.0), z + height / 2
        half = (radius, radius, (high - low) / 2)
        return Fit((Upright("cylinder", (0.0, 0.0, (low + high) / 2), half),), 0.0)

    def _fit(self, part: Placed, tilt: Float[np.ndarray, "3 3"], z: float) -> Fit:
        key = (id(part.mesh.points), id(part.mesh.faces), tilt.tobytes(), round(float(z), 6))
        if key not in self._fits:
            points = part.mesh.points @ tilt.T + np.array([0.0, 0.0, z])
            self._fits[key] = upright_solids(points, part.mesh.faces, self._tolerance_m, floor_m=0.0, head_m=OVERHEAD_M)
        return self._fits[key]


def _stands_up(solid: Upright) -> bool:
    """Returns whether a robot could meet a solid."""
    return rounded(solid.center_m[2] + solid.half_m[2]) > FLAT_M


def _around_ball(radius_m: float, z_m: float) -> Fit:
    """Returns the cylinder around a ball, as wide as the ball is between the floor and head height.

    A stack that follows a ball within a centimetre is forty solids, of which a robot meets five.

    Args:
        radius_m: The ball's.
        z_m: The height of its middle above the floor.
    """
    beyond_m = z_m - min(max(z_m, 0.0), OVERHEAD_M)
    wide_m = math.sqrt(radius_m**2 - beyond_m**2) if abs(beyond_m) < radius_m else radius_m
    low, high = max(z_m - radius_m, 0.0), z_m + radius_m
    solid = Upright("cylinder", (0.0, 0.0, (low + high) / 2), (wide_m, wide_m, (high - low) / 2))
    return Fit((solid,), math.hypot(wide_m, radius_m) - radius_m)


def _yaw_and_tilt(turn: Float[np.ndarray, "3 3"]) -> tuple[float, Float[np.ndarray, "3 3"]]:
    """Returns a turn as one about z after a tilt; a tilt of less than a tenth of a degree is a slip of the pen."""
    yaw = math.atan2(turn[1, 0], turn[0, 0]) if math.hypot(turn[0, 0], turn[1, 0]) > 1e-6 else 0.0
    cos, sin = math.cos(yaw), math.sin(yaw)
    tilt = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ turn
    tilt[np.abs(tilt) < _STRAIGHT] = 0.0
    for sign in (-1.0, 1.0):
        tilt[np.abs(tilt - sign) < _STRAIGHT**2] = sign
    return yaw, tilt + 0.0


def _turned(solid: Upright, yaw: float, x: float, y: float) -> Upright:
    """Returns a solid turned about z and moved."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    px, py, pz = solid.center_m
    center = (cos * px - sin * py + x, sin * px + cos * py + y, pz)
    turned = 0.0 if solid.shape == "cylinder" else math.remainder(solid.yaw_rad + yaw, math.tau)
    return solid._replace(center_m=center, yaw_rad=turned)


def unique(name: str, taken: Mapping[str, object] | Sequence[str] | set[str]) -> str:
    """Returns a name that is not taken: itself, or with a number behind it."""
    if name not in taken:
        return name
    number = 2
    while f"{name}_{number}" in taken:
        number += 1
    return f"{name}_{number}"
