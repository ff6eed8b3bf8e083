"""The sensors of a robot whose controller is no Python module: declared in a file of its bundle.

The fields are those that a controller's own sensors have (docs/guide/applications.md).
"""

import math
from typing import Annotated

from pydantic import Field

from specs.base import Spec

Length = Annotated[float, Field(ge=0.0, le=1e4)]
Place = Annotated[float, Field(ge=-1e4, le=1e4)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class LidarDeclaration(Spec):
    """A planar lidar; the defaults are those of a small indoor robot.

    Attributes:
        rays: How many, counter-clockwise over the field of view.
        range_m: What a ray reports if nothing is nearer.
        height_m: The scan's plane above the floor.
        fov_rad: Field of view; straight ahead is its middle.
        x_m, y_m, yaw_rad: Where it is mounted on the robot: ahead, to the left, turned counter-clockwise.
        sigma_m: Standard deviation of a range, its constant part.
        sigma_share: Standard deviation as a share of the distance.
        dropout: Probability that a ray sees nothing.
        resolution_m: Ranges are rounded to multiples of it; 0 for none.
    """

    rays: Annotated[int, Field(ge=1, le=4096)] = 360
    range_m: Length = 8.0
    height_m: Length = 0.2
    fov_rad: Annotated[float, Field(gt=0.0, le=2 * math.pi)] = 2 * math.pi
    x_m: Place = 0.0
    y_m: Place = 0.0
    yaw_rad: Place = 0.0
    sigma_m: Length = 0.0
    sigma_share: Share = 0.0
    dropout: Share = 0.0
    resolution_m: Length = 0.0


class OdometryDeclaration(Spec):
    """Wheels that count what they drive, and err; without it the robot knows its true pose.

    Attributes:
        sigma_m_per_m: Standard deviation of the driven distance, after a metre.
        sigma_rad_per_m, sigma_rad_per_rad: Of the heading, after a metre and after a turn of one radian.
    """

    sigma_m_per_m: Length = 0.0
    sigma_rad_per_m: Length = 0.0
    sigma_rad_per_rad: Length = 0.0


class BumperDeclaration(Spec):
    """Contact switches around the hull, the first centred straight ahead.

    Attributes:
        sectors: How many.
    """

    sectors: Annotated[int, Field(ge=1, le=64)] = 3
