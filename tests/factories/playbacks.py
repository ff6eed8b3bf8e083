"""A playback made by hand: along +x for a second, turning beyond half a turn, bumping into something on the way."""

from dataclasses import replace

import numpy as np

from specs.bundle_files import ColorCameraDeclaration, DepthCameraDeclaration
from specs.data.robot_shape import RobotPart
from tasks.results.playback.playback import BoxFilm, CameraFilm, Playback, Sight

SAMPLES, RAYS = 21, 4
_SQUARE_M = ((0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1))
WHEEL, DECK = (
    RobotPart(
        kind="box",
        size=(half_m, half_m, 0.05),
        position_m=(0.0, 0.0, top_m - 0.05),
        turn=(1.0, 0.0, 0.0, 0.0),
        color=color,
        outline_m=tuple((x * half_m / 0.1, y * half_m / 0.1) for x, y in _SQUARE_M),
        top_m=top_m,
    )
    for half_m, top_m, color in ((0.1, 0.1, (0.1, 0.1, 0.1, 1.0)), (0.2, 0.3, (0.2, 0.4, 0.8, 1.0)))
)
"""A small dark part, and a large blue one above it."""


def playback(samples: int = SAMPLES, rays: int = RAYS, people: int = 0, robots: int = 0) -> Playback:
    """Returns an episode of so many samples at 20 Hz; a goal is reached and something is touched in the middle.

    People walk along x, a metre apart, and other robots drive beside it.
    """
    number = np.arange(samples)
    last = samples - 1
    pose = np.stack([number / 20, np.full(samples, 0.5), (2 * np.pi - 0.2 + number / 20) % (2 * np.pi) - np.pi], 1)
    return Playback(
        job="simb-1/3",
        ending="collision",
        goals_m=np.array([[0.5, 0.5], [3.0, 1.0]]),
        arrived_m=0.3,
        radius_m=0.2,
        heights_m=(0.0, 0.3),
        sight=Sight((0.1, 0.0, 0.0), 0.2, 6.0, (2 * np.pi * np.arange(rays) / max(rays, 1)).astype(np.float32)),
        t_s=np.round(number / 20, 6),
        pose=pose.astype(np.float32),
        velocity=np.ones((samples, 3), np.float32),
        goal_index=(number > last // 2).astype(np.int32),
        acted=number < last,
        control=np.tile(number[:, None], 2).astype(np.float32),
        ranges_m=np.full((samples, rays), 1.5, np.float32),
        impulse_ns=np.where((number == last // 2) | (number == last // 2 + 1), 0.25, 0.0).astype(np.float32),
        people_m=np.stack(
            [np.stack([number / 40, np.full(samples, 1.0 + each)], 1) for each in range(people)], 1
        ).astype(np.float32)
        if people
        else np.zeros((samples, 0, 2), np.float32),
        robots_m=np.stack(
            [np.stack([number / 20, np.full(samples, -1.0 - each)], 1) for each in range(robots)], 1
        ).astype(np.float32)
        if robots
        else np.zeros((samples, 0, 2), np.float32),
    )


def boxed_playback() -> Playback:
    """Returns the same with two boxes: both come in the middle, and the second is gone before the end."""
    number = np.arange(SAMPLES)
    there = np.stack([number >= SAMPLES // 2, (number >= SAMPLES // 2) & (number < SAMPLES - 2)], axis=1)
    places_m = np.where(there[..., None], [[2.0, 1.5], [1.0, 0.5]], [[-1000.0, 1000.0], [-1010.0, 1000.0]])
    sizes_m = ((0.3, 1.2, 1.0), (0.4, 0.4, 0.6))
    return replace(playback(), boxes=BoxFilm(sizes_m, places_m.astype(np.float32), there))


def seen_playback() -> Playback:
    """Returns the same of a robot that sees a wall come nearer, picture by picture, and grey become lighter."""
    eye, lens = DepthCameraDeclaration(columns=8, rows=4, range_m=6.0), ColorCameraDeclaration(columns=6, rows=4)
    depth_m = np.full((3, 4, 8), 6.0, np.float32)  # nothing on the right
    depth_m[:, :, :4] = np.array([4.0, 2.0, 0.1])[:, None, None]
    colors = np.repeat([40, 120, 200], 4 * 6 * 3).astype(np.uint8).reshape(3, 4, 6, 3)
    t_s = np.array([0.0, 0.4, 0.8])
    return replace(playback(), depth=CameraFilm(eye, t_s, depth_m), color=CameraFilm(lens, t_s, colors))
