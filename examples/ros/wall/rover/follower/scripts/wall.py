"""Where to drive along a wall to the right, by a picture of depth and what the camera says of itself."""

import math

import numpy as np

CAMERA_YAW_RAD, CAMERA_AHEAD_M = -0.7, 0.1
SPEED_M_S, TURN_RAD_S = 0.3, 0.8
BESIDE_M, NEAR_M, LOOK_M, HALF_WIDTH_M = 0.5, 0.55, 0.8, 0.2


def speeds(depth_m, focal_px, middle_px):
    """Returns how fast to drive (m/s) and to turn (rad/s, counter-clockwise).

    Args:
        depth_m: A row of the picture at the camera's height; infinite where nothing is seen.
        focal_px: Of the camera, as in the matrix K of its CameraInfo.
        middle_px: Likewise: the column that what is straight ahead of it falls on.
    """
    right_m = (np.arange(len(depth_m)) - middle_px) / focal_px * depth_m
    seen = np.isfinite(depth_m)
    cos, sin = math.cos(CAMERA_YAW_RAD), math.sin(CAMERA_YAW_RAD)
    ahead_m = (cos * depth_m + sin * right_m)[seen] + CAMERA_AHEAD_M
    left_m = (sin * depth_m - cos * right_m)[seen]
    free_m = ahead_m[abs(left_m) < HALF_WIDTH_M].min(initial=LOOK_M)
    if free_m < NEAR_M:
        return 0.0, TURN_RAD_S
    wall_m = -left_m[(left_m < 0) & (ahead_m < LOOK_M)].max(initial=-LOOK_M)
    return SPEED_M_S * free_m / LOOK_M, float(np.clip(2.0 * (BESIDE_M - wall_m), -TURN_RAD_S, TURN_RAD_S))
