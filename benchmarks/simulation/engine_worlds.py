"""Worlds of a given number of obstacles, and episodes in them that explore until their time is over."""

import numpy as np

from benchmarks.harness import ROOT
from specs.data.episode import ApplicationLaunch, EpisodeRequest
from specs.data.world import Certificate, OccupancyMap, Rectangle, Room, Solid, World
from specs.data.world import Finish as Covering

APPLICATIONS = ROOT / "benchmarks/applications"
ROBOT, SCENARIO = "a" * 64, "b" * 64
FOLDERS = {ROBOT: APPLICATIONS / "explorer", SCENARIO: APPLICATIONS / "endless"}
ROBOT_FILE = FOLDERS[ROBOT] / "robot.xml"
_HALF_M = 6.0
_CLEAR_M = 1.2
_PLAIN = Covering(material="Paint", pattern="plain", color=(1, 1, 1), accent=(1, 1, 1), repeat_m=(1.0, 1.0))


_CERTIFICATE = Certificate(
    origin_clear_radius_m=1.0,
    guaranteed_robot_radius_m=0.18,
    reachable_robot_radius_m=0.18,
    doors_as_set_robot_radius_m=0.18,
    narrowest_passage_m=0.0,
    free_floor_share=1.0,
    area_error_mean=0.0,
    overlaps=0,
)


def bench_world(seed: int, obstacles: int) -> World:
    """Returns a square hall of 12 m with four walls, and boxes, turned boxes and posts strewn about."""
    rng = np.random.default_rng([seed, obstacles])
    walls = tuple(
        _solid("box", f"wall-{k}", (x, y), (hx, hy), 0.0)
        for k, (x, y, hx, hy) in enumerate(
            [
                (_HALF_M, 0.0, 0.05, _HALF_M),
                (-_HALF_M, 0.0, 0.05, _HALF_M),
                (0.0, _HALF_M, _HALF_M, 0.05),
                (0.0, -_HALF_M, _HALF_M, 0.05),
            ]
        )
    )
    strewn = tuple(_strewn(k, rng) for k in range(obstacles - len(walls)))
    floor = Rectangle(x_min_m=-_HALF_M, y_min_m=-_HALF_M, x_max_m=_HALF_M, y_max_m=_HALF_M)
    return World(
        generator="benchmarks",
        template_digest="0" * 64,
        seed=seed,
        generation="bench",
        name=f"hall-{obstacles}-{seed}",
        floorplan_index=1,
        interior_index=1,
        ceiling_height_m=2.5,
        wall_thickness_m=0.1,
        footprint=floor,
        rooms=(Room(name="Hall", type="Living", floor=floor, flooring=_PLAIN, walls=_PLAIN),),
        passages=(),
        walls=(*walls, *strewn),
        furniture=(),
        lights=(),
        map=OccupancyMap(resolution_m=_HALF_M, origin_m=(-_HALF_M, -_HALF_M), columns=2, rows=2, runs=(4,)),
        certificate=_CERTIFICATE,
    )


def as_prisms(world: World) -> World:
    """Returns a hall whose boxes are written as prisms of four corners, as walls of imported buildings may be."""

    def prism(solid: Solid) -> Solid:
        x, y, _ = solid.half_extents_m
        corners = ((-x, -y), (x, -y), (x, y), (-x, y))
        return solid if solid.shape != "box" else solid.model_copy(update={"shape": "prism", "outline_m": corners})

    return world.model_copy(update={"version": "2", "walls": tuple(map(prism, world.walls))})


def explorations(count: int, worlds: int, duration_s: float) -> list[EpisodeRequest]:
    """Returns episodes of the benchmarks' own applications, spread over worlds ``bench/0``, ``bench/1``, ..."""
    return [
        EpisodeRequest(
            index=k,
            world=f"bench/{k % worlds}",
            seed=k,
            robot=ApplicationLaunch(
                name="explorer", version="1", digest=ROBOT, package="explorer", launch_file="reactive"
            ),
            scenario=ApplicationLaunch(
                name="endless", version="1", digest=SCENARIO, package="endless", launch_file="timed"
            ),
            environment={},
            duration_s=duration_s,
        )
        for k in range(count)
    ]


def starts(count: int) -> np.ndarray:
    """Returns the starts that the scenario gives those episodes: (x m, y m, yaw rad)."""
    found = np.empty((count, 3))
    for k in range(count):
        rng = np.random.default_rng(k)
        found[k] = (*rng.uniform(-0.5, 0.5, 2), rng.uniform(-np.pi, np.pi))
    return found


def _strewn(number: int, rng: np.random.Generator) -> Solid:
    while True:
        x, y = (float(each) for each in rng.uniform(-_HALF_M + 0.3, _HALF_M - 0.3, 2))
        if np.hypot(x, y) > _CLEAR_M:
            break
    if number % 4 == 3:
        radius = float(rng.uniform(0.04, 0.2))
        return _solid("cylinder", f"post-{number}", (x, y), (radius, radius), 0.0)
    yaw = float(rng.uniform(-1.5, 1.5)) if number % 4 == 2 else 0.0
    return _solid("box", f"box-{number}", (x, y), (rng.uniform(0.05, 0.3), rng.uniform(0.05, 0.3)), yaw)


def _solid(shape: str, name: str, center: tuple[float, float], half: tuple[float, float], yaw_rad: float) -> Solid:
    return Solid.model_validate(
        {
            "name": name,
            "shape": shape,
            "center_m": (*center, 0.5),
            "half_extents_m": (*half, 0.5),
            "yaw_rad": yaw_rad,
            "color": (0.5, 0.5, 0.5),
        }
    )
