"""What a robot does about a scan: a pure function, for nodes of ROS 1, of ROS 2, and none."""

import math
from collections.abc import Iterable


def steer(angle_min: float, angle_increment: float, ranges: Iterable[float]) -> tuple[float, float]:
    """Returns speed ahead (m/s) and turn rate (rad/s): on if the way is free, else to the side that is freer."""
    ahead, left, right = math.inf, 0.0, 0.0
    for k, distance in enumerate(ranges):
        angle = math.remainder(angle_min + k * angle_increment, 2.0 * math.pi)
        seen = min(distance, 8.0)
        if abs(angle) < 0.6:
            ahead = min(ahead, seen)
        if 0.0 < angle < 1.6:
            left += seen
        elif -1.6 < angle < 0.0:
            right += seen
    if ahead < 0.6:
        return 0.0, math.copysign(1.2, left - right)
    return 0.4 * min(1.0, ahead - 0.3), 0.3 * math.sin(left - right)
