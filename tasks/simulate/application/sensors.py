"""What a robot senses with: read from its controller object, checked, and the same for every engine.

A controller has its sensors as attributes: ``lidar``, ``odometry``, ``bumper``. Each is an object with the attributes
of the tuple here of that name; those that have a default may be left out. What decides array shapes or what is staged
(a lidar's ``rays``, ``range_m``, ``height_m`` and ``fov_rad``, a bumper's ``sectors``) is the same in all episodes of a
program; the other numbers may follow from environment variables, and are then traced values.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar, cast

import jax
import numpy as np
from jaxtyping import Float, Float32

from tasks.simulate.application.code import BundleCrash, CrashCode, guarded

Scalar = float | Float[jax.Array, ""]
_ROBOT: CrashCode = "RobotApplicationCrash"
_TURN_RAD = 2 * math.pi


class Lidar(NamedTuple):
    """A planar lidar.

    Attributes:
        rays: How many, evenly spread counter-clockwise: over the full turn, beginning straight ahead, or over the field
            of view, from its right edge to its left one.
        range_m: What it reports where nothing is nearer.
        height_m: Its plane's height above the floor.
        fov_rad: Its field of view; straight ahead is in the middle.
        x_m, y_m, yaw_rad: Where it is mounted on the robot: ahead, to the left, turned counter-clockwise.
        sigma_m: Standard deviation of a range, at any distance.
        sigma_share: Standard deviation that grows with the distance, as a share of it.
        dropout: Probability that a ray reports the range although something is nearer.
        resolution_m: Ranges are rounded to multiples of it; 0 for none.
    """

    rays: int
    range_m: float
    height_m: float
    fov_rad: float = _TURN_RAD
    x_m: Scalar = 0.0
    y_m: Scalar = 0.0
    yaw_rad: Scalar = 0.0
    sigma_m: Scalar = 0.0
    sigma_share: Scalar = 0.0
    dropout: Scalar = 0.0
    resolution_m: Scalar = 0.0


class Odometry(NamedTuple):
    """Wheel odometry: the pose that the robot believes to have drifts away from its true one.

    Errors are added up step by step, so their standard deviations grow with the square root of the way.

    Attributes:
        sigma_m_per_m: Of the way driven, after a metre.
        sigma_rad_per_m: Of the heading, after a metre.
        sigma_rad_per_rad: Of the heading, after turning by a radian.
    """

    sigma_m_per_m: Scalar = 0.0
    sigma_rad_per_m: Scalar = 0.0
    sigma_rad_per_rad: Scalar = 0.0


class Bumper(NamedTuple):
    """Contact switches around the hull: sector 0 is centred straight ahead, the others follow counter-clockwise."""

    sectors: int


class Sensors(NamedTuple):
    """All sensors of a robot.

    Attributes:
        lidar: One without rays when the robot has none.
        odometry: None when the robot knows its true pose.
        bumper: One without sectors when the robot has none.
    """

    lidar: Lidar
    odometry: Odometry | None
    bumper: Bumper


NO_LIDAR = Lidar(rays=0, range_m=1.0, height_m=0.0)
NO_BUMPER = Bumper(sectors=0)
_LEAST_AND_MOST = {
    "rays": (1, 4096),
    "range_m": (0.01, 1e4),
    "height_m": (0.0, 1e4),
    "fov_rad": (1e-3, _TURN_RAD + 1e-6),
    "x_m": (-1e4, 1e4),
    "y_m": (-1e4, 1e4),
    "yaw_rad": (-1e4, 1e4),
    "dropout": (0.0, 1.0),
    "sectors": (1, 360),
}
_NOT_NEGATIVE = (0.0, 1e4)
_WHOLE = ("rays", "sectors")
_SHARED = ("rays", "range_m", "height_m", "fov_rad")
Kind = TypeVar("Kind", Lidar, Odometry, Bumper)


def sensors_of(controller: object) -> Sensors:
    """Returns what a controller declares; its numbers may be traced, and none is checked."""
    lidar, odometry, bumper = (getattr(controller, name, None) for name in ("lidar", "odometry", "bumper"))
    return Sensors(
        lidar=NO_LIDAR if lidar is None else _filled(Lidar, lidar),
        odometry=None if odometry is None else _filled(Odometry, odometry),
        bumper=NO_BUMPER if bumper is None else _filled(Bumper, bumper),
    )


def read_sensors(make_controller: Callable[..., object], environment: Mapping[str, object]) -> Sensors:
    """Returns the sensors of a robot application in plain numbers, for given environment variables.

    Raises:
        BundleCrash: The controller cannot be made, or declares what cannot be; tells of all faults at once.
    """
    made = guarded(_ROBOT, "controller(environment)", make_controller, environment)
    lidar, odometry, bumper = guarded(_ROBOT, "the controller's sensors", sensors_of, made)
    faults = [
        *(() if lidar is NO_LIDAR else _faults("controller.lidar", lidar)),
        *(() if odometry is None else _faults("controller.odometry", odometry)),
        *(() if bumper is NO_BUMPER else _faults("controller.bumper", bumper)),
    ]
    if faults:
        raise BundleCrash(_ROBOT, "; ".join(faults))
    return Sensors(_plain(lidar), None if odometry is None else _plain(odometry), _plain(bumper))


def require_shared(program: Sensors, episode: Sensors) -> None:
    """Checks that an episode's sensors fit the program that it shares with others.

    Raises:
        BundleCrash: What decides array shapes differs between episodes, so it follows from a numeric variable.
    """
    pairs = [(f"lidar.{name}", getattr(program.lidar, name), getattr(episode.lidar, name)) for name in _SHARED]
    pairs.append(("bumper.sectors", program.bumper.sectors, episode.bumper.sectors))
    pairs.append(("odometry", program.odometry is not None, episode.odometry is not None))
    for name, one, other in pairs:
        if one != other:
            raise BundleCrash(
                _ROBOT,
                f"controller.{name}: {other} in this episode, {one} in its program: must not follow from a variable "
                "that is a number; a text, such as 'x64' instead of '64', makes each value a program of its own",
            )


def ray_angles(lidar: Lidar) -> Float32[np.ndarray, "rays"]:
    """Returns the rays' directions in the lidar's own frame, radians counter-clockwise from straight ahead."""
    steps = np.arange(lidar.rays)
    if lidar.fov_rad >= _TURN_RAD:
        return (_TURN_RAD * steps / max(lidar.rays, 1)).astype(np.float32)
    from_right = steps / (lidar.rays - 1) if lidar.rays > 1 else np.full(1, 0.5)
    return (lidar.fov_rad * (from_right - 0.5)).astype(np.float32)


def is_set(value: Scalar) -> bool:
    """Returns whether a number may be other than 0: a traced one is only known when the program runs."""
    return not (isinstance(value, int | float) and value == 0.0)


def _filled(kind: type[Kind], declared: object) -> Kind:
    """Returns the tuple of that kind with what a bundle declares; None for what is missing and has no default."""
    values: list[Any] = [getattr(declared, name, kind._field_defaults.get(name)) for name in kind._fields]
    return kind(*values)


def _faults(path: str, sensor: Lidar | Odometry | Bumper) -> Iterator[str]:
    for name, value in sensor._asdict().items():
        least, most = _LEAST_AND_MOST.get(name, _NOT_NEGATIVE)
        number = _number(value)
        if number is None or not least <= number <= most or (name in _WHOLE and number % 1):
            shown = "missing" if value is None else repr(value)
            kind = "a whole number" if name in _WHOLE else "a number"
            yield f"{path}.{name}: {shown}: must be {kind} from {least:g} to {most:g}"


def _number(value: object) -> float | None:
    """Returns a scalar as a number, or None for whatever else a bundle has there."""
    if isinstance(value, str):
        return None
    try:
        number = float(cast("float", value))
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _plain(sensor: Kind) -> Kind:
    values: list[Any] = [int(each) if name in _WHOLE else float(each) for name, each in sensor._asdict().items()]
    return type(sensor)(*values)
