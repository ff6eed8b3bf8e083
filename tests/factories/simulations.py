"""Worlds and requests for the simulation's tests, drawn by hand so that no generator is needed."""

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, ParamSpec

import jax
import numpy as np
from jaxtyping import Float64

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import Furniture, Rectangle, Solid, World
from tasks.simulate.chunk.chunk_simulation import ready_chunk, simulate_episodes
from tasks.simulate.chunk.lane_pool import lane_row
from tasks.simulate.lane.control_step import StepRecord
from tests.factories.worlds import apartment
from tests.repository import ROOT

if TYPE_CHECKING:  # it imports JAX, whose settings a worker makes first
    from tasks.simulate.application.contract import HostMap

P = ParamSpec("P")
REPOSITORY = ROOT
BUNDLES = ROOT / "tests" / "simulate" / "bundles"
ROOT_ROBOTS = tuple(sorted([*ROOT.glob("applications/*/robot.xml"), *ROOT.glob("examples/*/*/robot.xml")]))
"""The robots that Simyard brings along."""
COURIER, DELIVERY, FAULTY, DRIFT, PLAIN = ("c" * 64, "d" * 64, "f" * 64, "e" * 64, "a" * 64)
FOLDERS = {
    COURIER: REPOSITORY / "applications" / "courier",
    DELIVERY: REPOSITORY / "applications" / "delivery",
    FAULTY: BUNDLES / "faulty",
    DRIFT: BUNDLES / "drift",
    PLAIN: BUNDLES / "plain",
}
ROBOT = ApplicationLaunch(name="courier", version="1", digest=COURIER, package="courier", launch_file="go_to_goal")
SCENARIO = ApplicationLaunch(name="delivery", version="1", digest=DELIVERY, package="delivery", launch_file="rooms")
PUSHER = ApplicationLaunch(name="faulty", version="1", digest=FAULTY, package="faulty", launch_file="pushing")
ENDLESS = ApplicationLaunch(name="drift", version="1", digest=DRIFT, package="drift", launch_file="endless")


def delivery(index: int, *, world: str, seed: int = 0, speed: str = "0.6", duration_s: float = 60.0) -> EpisodeRequest:
    """Returns an episode of the shipped applications."""
    return EpisodeRequest(
        index=index,
        world=world,
        seed=seed,
        robot=ROBOT,
        scenario=SCENARIO,
        environment={"MAX_SPEED": speed},
        duration_s=duration_s,
    )


def pushing(
    index: int, *, world: str, seed: int = 0, fault: str = "0", duration_s: float = 3.0, launch: str = "pushing"
) -> EpisodeRequest:
    """Returns an episode of the test's own applications."""
    return EpisodeRequest(
        index=index,
        world=world,
        seed=seed,
        robot=PUSHER.model_copy(update={"launch_file": launch}),
        scenario=ENDLESS,
        environment={"FAULT": fault},
        duration_s=duration_s,
    )


def driven_chunk(
    requests: list[EpisodeRequest], worlds: dict[str, World], engine: str, lanes: int
) -> tuple[list[EpisodeResult], StepRecord]:
    """Returns the rows of episodes that are driven together, and the record of all their steps, lanes first."""
    chunk = ready_chunk(requests, worlds, FOLDERS, lanes=lanes, engine=engine)
    assert chunk.run is not None
    state, records = chunk.run.begin(), list[StepRecord]()
    while not np.all(state.done):
        state, record = chunk.run.advance(state)
        records.append(jax.tree.map(np.asarray, record))
    whole: StepRecord = jax.tree.map(lambda *each: np.concatenate(each, axis=1), *records)
    end, poses = jax.device_get(state._replace(controller=None)), [np.asarray(whole.pose)]
    rows = [lane_row(chunk.program, None, lane, place, end, poses) for place, lane in enumerate(chunk.lanes)]
    return rows, whole


def cluttered(seed: int) -> World:
    """Returns the hand-drawn apartment with ten more pieces strewn about, the metre around the origin left free."""
    rng = np.random.default_rng(seed)
    base = apartment(name=f"cluttered-{seed}")
    pieces = [_piece(base, number, rng) for number in range(10)]
    return base.model_copy(update={"furniture": (*base.furniture, *pieces)})


def pen(side_m: float, seed: int) -> World:
    """Returns one square room full of posts and turned blocks: a place to bump into things."""
    rng = np.random.default_rng(seed)
    half = side_m / 2
    walls = tuple(
        _box(f"wall-{number}", (x, y), (hx, hy), 0.0)
        for number, (x, y, hx, hy) in enumerate(
            [(half, 0, 0.05, half), (-half, 0, 0.05, half), (0, half, half, 0.05), (0, -half, half, 0.05)]
        )
    )
    floor = Rectangle(x_min_m=-half, y_min_m=-half, x_max_m=half, y_max_m=half)
    base = apartment(name=f"pen-{seed}")
    room = base.rooms[0].model_copy(update={"floor": floor})
    world = base.model_copy(
        update={
            "name": f"pen-{seed}",
            "walls": walls,
            "rooms": (room,),
            "passages": (),
            "furniture": (),
            "footprint": floor,
        }
    )
    return world.model_copy(update={"furniture": tuple(_piece(world, number, rng) for number in range(14))})


def with_prisms(world: World) -> World:
    """Returns a world whose boxes are written as prisms, each by its four corners."""

    def prism(solid: Solid) -> Solid:
        x, y, _ = solid.half_extents_m
        corners = ((-x, -y), (x, -y), (x, y), (-x, y))
        return solid if solid.shape != "box" else solid.model_copy(update={"shape": "prism", "outline_m": corners})

    pieces = [
        each.model_copy(update={"solids": tuple(prism(solid) for solid in each.solids)}) for each in world.furniture
    ]
    return world.model_copy(
        update={
            "version": "2",
            "walls": tuple(prism(wall) for wall in world.walls),
            "doors": tuple(door.model_copy(update={"leaf": prism(door.leaf)}) for door in world.doors),
            "furniture": tuple(pieces),
        }
    )


def with_wedges(world: World, seed: int) -> World:
    """Returns a world in which prisms of 3 to 8 corners stand in the place of pieces of furniture."""
    rng = np.random.default_rng(seed)
    pieces = [
        each.model_copy(update={"solids": tuple(_wedge(solid, rng) for solid in each.solids)})
        for each in world.furniture
    ]
    return world.model_copy(update={"version": "2", "furniture": tuple(pieces)})


def _wedge(solid: Solid, rng: np.random.Generator) -> Solid:
    corners = convex(rng, max(solid.half_extents_m[:2]))
    half = np.ptp(corners, axis=0) / 2
    return solid.model_copy(
        update={
            "shape": "prism",
            "outline_m": tuple((float(x), float(y)) for x, y in corners),
            "half_extents_m": (float(half[0]), float(half[1]), solid.half_extents_m[2]),
            "yaw_rad": float(rng.uniform(-3.0, 3.0)),
        }
    )


def convex(rng: np.random.Generator, size_m: float) -> np.ndarray:
    """Returns 3 to 8 corners of a convex outline, counter-clockwise, about the middle of the box around it."""
    turns = np.sort(rng.uniform(0.0, 2 * np.pi, rng.integers(3, 9)))
    corners = np.stack([np.cos(turns), np.sin(turns)], axis=1) * rng.uniform(0.1, 1.0, 2) * size_m
    turn = rng.uniform(-np.pi, np.pi)
    corners = corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return corners - (corners.min(axis=0) + corners.max(axis=0)) / 2


def hall(half_width_m: float, *, gap_m: float | None = None) -> World:
    """Returns two bare rooms in a row along x, of 5 m each.

    Args:
        half_width_m: Along y.
        gap_m: In the middle of a wall between them, which leaves a metre free at both ends; None for no wall.
    """
    base = apartment(name="hall")
    west, east = -2.5, 7.5
    walls = tuple(
        _box(f"wall-{number}", (x, y), (hx, hy), 0.0)
        for number, (x, y, hx, hy) in enumerate(
            [
                (west, 0, 0.05, half_width_m),
                (east, 0, 0.05, half_width_m),
                (2.5, half_width_m, 5.0, 0.05),
                (2.5, -half_width_m, 5.0, 0.05),
            ]
        )
    )
    if gap_m is not None:
        middle, half = (gap_m / 2 + half_width_m - 1.0) / 2, (half_width_m - 1.0 - gap_m / 2) / 2
        walls += tuple(_box(f"between{y:+g}", (2.5, y), (0.05, half), 0.0) for y in (middle, -middle))
    spans = ((west, 2.5), (2.5, east))
    rooms = tuple(
        room.model_copy(
            update={"floor": Rectangle(x_min_m=low, x_max_m=high, y_min_m=-half_width_m, y_max_m=half_width_m)}
        )
        for room, (low, high) in zip(base.rooms[:2], spans, strict=True)
    )
    outer = Rectangle(x_min_m=west, x_max_m=east, y_min_m=-half_width_m, y_max_m=half_width_m)
    return base.model_copy(update={"walls": walls, "rooms": rooms, "passages": (), "furniture": (), "footprint": outer})


def _piece(world: World, number: int, rng: np.random.Generator) -> Furniture:
    while True:
        room = world.rooms[int(rng.integers(len(world.rooms)))].floor
        x = float(rng.uniform(room.x_min_m + 0.4, room.x_max_m - 0.4))
        y = float(rng.uniform(room.y_min_m + 0.4, room.y_max_m - 0.4))
        # The doorway of the hand-drawn apartment is at (2.55, 0.5).
        if np.hypot(x, y) > 1.3 and np.hypot(x - 2.55, y - 0.5) > 1.2:
            break
    name = f"piece-{number}"
    if number % 2:
        solid = _box(name, (x, y), (rng.uniform(0.05, 0.25), rng.uniform(0.05, 0.25)), float(rng.uniform(-1.5, 1.5)))
    else:
        radius = float(rng.uniform(0.05, 0.2))
        solid = Solid(
            name=name,
            shape="cylinder",
            center_m=(x, y, 0.5),
            half_extents_m=(radius, radius, 0.5),
            yaw_rad=0.0,
            color=(0.5, 0.5, 0.5),
        )
    return Furniture(
        name=name, model_type="Storage", room=world.rooms[0].name, center_m=(x, y), yaw_rad=0.0, solids=(solid,)
    )


def _box(name: str, center: tuple[float, float], half: tuple[float, float], yaw_rad: float) -> Solid:
    return Solid(
        name=name,
        shape="box",
        center_m=(*center, 0.5),
        half_extents_m=(*half, 0.5),
        yaw_rad=yaw_rad,
        color=(0.5, 0.5, 0.5),
    )


def cell_of(floor: "HostMap", point_m: Float64[np.ndarray, "2"]) -> tuple[int, int]:
    """Returns the (row, column) of the cell that holds a point, clipped to the grid."""
    column, row = np.rint((point_m - floor.origin_m) / floor.cell_m).astype(int)
    rows, columns = floor.clearance_m.shape
    return int(np.clip(row, 0, rows - 1)), int(np.clip(column, 0, columns - 1))


def _as_rows(simulate: Callable[P, EpisodeColumns]) -> Callable[P, list[EpisodeResult]]:
    @wraps(simulate)
    def rows(*args: P.args, **kwargs: P.kwargs) -> list[EpisodeResult]:
        return simulate(*args, **kwargs).rows()

    return rows


simulate_lanes = _as_rows(simulate_episodes)
"""Returns what ``simulate_episodes`` does, as rows."""
