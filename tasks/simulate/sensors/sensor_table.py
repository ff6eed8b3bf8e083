"""The table of sensors, and the sensors of a robot: read from its controller object, and checked.

A controller has its sensors as attributes, by the names in ``SENSORS``. Each is an object with the attributes of the
tuple in its module; those that have a default may be left out. Cameras may be a list of such objects. What decides
array shapes or what is staged is the same in all episodes of a program; the other numbers may follow from environment
variables, and are then traced values.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeGuard, cast

import jax.numpy as jnp
from pydantic import ValidationError

from specs.bundle_files import MOST_CAMERAS, ONE_OF_A_KIND, ColorCameraDeclaration
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.sensors.bumper import BUMPER, Bumper
from tasks.simulate.sensors.depth_camera import DEPTH_CAMERA, DepthCamera
from tasks.simulate.sensors.gps import GPS, Gps
from tasks.simulate.sensors.imu import COMPASS, IMU, Compass, Imu
from tasks.simulate.sensors.lidar import LIDAR, Lidar
from tasks.simulate.sensors.odometry import ODOMETRY, WHEEL_ENCODERS, Odometry, WheelEncoders
from tasks.simulate.sensors.range_finders import CLIFF_SENSORS, RANGE_FINDERS, CliffSensors, RangeFinders
from tasks.simulate.sensors.sensor import Drive, Fields, Limits, Memory, Pace, Sensor, Situation, pace_of

_ROBOT: CrashCode = "RobotApplicationCrash"
_NOT_NEGATIVE = (0.0, 1e4)


class Sensors(NamedTuple):
    """All sensors of a robot, in the order of ``SENSORS``; see the record of each for a robot without it."""

    lidar: Lidar
    odometry: Odometry | None
    bumper: Bumper
    depth_camera: DepthCamera | None = None
    imu: Imu | None = None
    range_finders: RangeFinders | None = None
    wheel_encoders: WheelEncoders | None = None
    compass: Compass | None = None
    cliff_sensors: CliffSensors | None = None
    gps: Gps | None = None


SENSORS: tuple[Sensor[Any], ...] = (
    *(LIDAR, ODOMETRY, BUMPER, DEPTH_CAMERA, IMU, RANGE_FINDERS),
    *(WHEEL_ENCODERS, COMPASS, CLIFF_SENSORS, GPS),
)
# Of every sensor that has a pace.
_PACE_LIMITS: Limits = {"rate_hz": (0.0, 1e3), "latency_steps": (0, 20)}
_PACE_WHOLE = "latency_steps"
# What a camera has that is no number.
_OF_LISTS = frozenset({"name", "others"})


def sensors_of(controller: object) -> Sensors:
    """Returns what a controller declares; its numbers may be traced, and none is checked."""
    declared = ((sensor, getattr(controller, sensor.name, None)) for sensor in SENSORS)
    values: list[Any] = [sensor.absent if own is None else _filled_all(sensor, own) for sensor, own in declared]
    return Sensors(*values)


def read_sensors(make_controller: Callable[..., object], environment: Mapping[str, object]) -> Sensors:
    """Returns the sensors of a robot application in plain numbers, for given environment variables.

    Raises:
        BundleCrash: The controller cannot be made, or declares what cannot be; tells of all faults at once.
    """
    made = call_bundle(_ROBOT, "controller(environment)", make_controller, environment)
    _require_lists_of_cameras(made, [sensor.name for sensor in SENSORS])
    found = call_bundle(_ROBOT, "the controller's sensors", sensors_of, made)
    faults = [
        fault
        for sensor, declared in zip(SENSORS, found, strict=True)
        if declared is not sensor.absent
        for one in _members(declared)
        for fault in _faults(sensor, one)
    ]
    if faults:
        raise BundleCrash(_ROBOT, "; ".join(faults))
    sensors = Sensors(*(_plain(sensor, declared) for sensor, declared in zip(SENSORS, found, strict=True)))
    if sensors.depth_camera and sensors.depth_camera.others:
        try:
            _ = sensors.depth_camera.declared
        except ValidationError as exc:
            raise BundleCrash(_ROBOT, f"controller.{DEPTH_CAMERA.name}: {exc.errors()[0]['msg']}") from exc
    return sensors


COLOR_CAMERA = "color_camera"


def read_color_camera(
    make_controller: Callable[..., object], environment: Mapping[str, object]
) -> ColorCameraDeclaration | None:
    """Returns a robot's colour camera in plain numbers; None for a robot without.

    It is no sensor of the table: the host draws what it sees, for controllers that run there.

    Raises:
        BundleCrash: It declares what cannot be; tells of all faults at once.
    """
    made = call_bundle(_ROBOT, "controller(environment)", make_controller, environment)
    _require_lists_of_cameras(made, [COLOR_CAMERA])
    given = call_bundle(_ROBOT, f"the controller's {COLOR_CAMERA}", _declared_color, made)
    try:
        return None if given is None else ColorCameraDeclaration.model_validate(given)
    except ValidationError as exc:
        faults = [
            ".".join([COLOR_CAMERA, *map(str, each["loc"])])
            + (f": {each['input']:g}" if isinstance(each["input"], float) else "")
            + f": {each['msg']}"
            for each in exc.errors()
        ]
        raise BundleCrash(_ROBOT, "; ".join(f"controller.{fault}" for fault in faults)) from exc


def _declared_color(made: object) -> object:
    declared = getattr(made, COLOR_CAMERA, None)
    if declared is None:
        return None
    fields = ColorCameraDeclaration.model_fields.keys() - _OF_LISTS
    found = [
        {name: float(getattr(one, name)) for name in fields if hasattr(one, name)}
        | ({"name": str(getattr(one, "name", ""))} if _is_list(declared) or getattr(declared, "others", ()) else {})
        for one in _members(declared)
    ]
    return found if _is_list(declared) or len(found) > 1 else found[0]


def _is_list(declared: object) -> TypeGuard[Sequence[Any]]:
    # A tuple with names is a record of one.
    return isinstance(declared, list | tuple) and not hasattr(declared, "_fields")


def _members(declared: Any) -> Sequence[Any]:  # noqa: ANN401 - whatever a bundle has there
    """Returns the cameras of a list; of anything else that alone."""
    return declared if _is_list(declared) else (declared, *getattr(declared, "others", ()))


def _require_lists_of_cameras(made: object, names: Iterable[str]) -> None:
    """Checks that a controller declares no list of sensors, but of some cameras.

    Raises:
        BundleCrash: It does; tells of all of them at once.
    """
    declared = ((name, call_bundle(_ROBOT, f"the controller's {name}", getattr, made, name, None)) for name in names)
    lists = [(name, own) for name, own in declared if _is_list(own)]
    faults: list[str] = []
    for name, own in lists:
        if name not in {DEPTH_CAMERA.name, COLOR_CAMERA}:
            faults.append(f"controller.{name}: {ONE_OF_A_KIND}")
        elif not 2 <= len(own) <= MOST_CAMERAS:
            faults.append(
                f"controller.{name}: {len(own)} in a list of cameras: must be 2 to {MOST_CAMERAS}, or no list"
            )
    if faults:
        raise BundleCrash(_ROBOT, "; ".join(faults))


def require_shared(program: Sensors, episode: Sensors) -> None:
    """Checks that an episode's sensors fit the program that it shares with others.

    Raises:
        BundleCrash: What decides array shapes differs between episodes, so it follows from a numeric variable.
    """
    for name, one, other in _shared(program, episode):
        if one != other:
            raise BundleCrash(
                _ROBOT,
                f"controller.{name}: {other} in this episode, {one} in its program: must not follow from a variable "
                "that is a number; a text, such as 'x64' instead of '64', makes each value a program of its own",
            )


def begin_sensors(program: Sensors, own: Sensors, start: Situation) -> dict[str, Memory]:
    """Returns what the sensors remember before the first control step, by name.

    Args:
        program: The sensors that all lanes share.
        own: The lane's.
        start: The lane then.
    """
    return {
        sensor.name: None if shared is None else _begin(sensor, shared, declared, start)
        for sensor, shared, declared in zip(SENSORS, program, own, strict=True)
    }


def feel_all(program: Sensors, own: Sensors, memories: Mapping[str, Memory], drive: Drive) -> dict[str, Memory]:
    """Returns what the sensors remember after a control step that an engine drove, by name.

    Args:
        program: The sensors that all lanes share.
        own: The lane's.
        memories: What they remembered before.
        drive: The control step.
    """
    return {
        sensor.name: None if shared is None else _feel(sensor, shared, declared, memories[sensor.name], drive)
        for sensor, shared, declared in zip(SENSORS, program, own, strict=True)
    }


def observe_all(program: Sensors, own: Sensors, memories: Mapping[str, Memory], situation: Situation) -> Fields:
    """Returns what the sensors give before a control step, as fields of the observation.

    Args:
        program: The sensors that all lanes share.
        own: The lane's.
        memories: What they remember, by name.
        situation: The lane before the step.
    """
    fields: Fields = {}
    for sensor, shared, declared in zip(SENSORS, program, own, strict=True):
        if shared is not None:
            fields |= _observe(sensor, shared, declared, memories[sensor.name], situation)
    return fields


class _Kept(NamedTuple):
    """What a sensor with a pace remembers, and its readings: those on their way, and the one that is there."""

    memory: Memory
    readings: Fields


def _pace(sensor: Sensor[Any], shared: Any) -> Pace | None:  # noqa: ANN401 - the sensor's own tuple
    """Returns the pace at which readings are kept; None for a sensor that reads at each step, or keeps them itself."""
    pace = pace_of(shared)
    return None if sensor.keeps or pace == Pace(1, 0) else pace


def _begin(sensor: Sensor[Any], shared: Any, own: Any, start: Situation) -> Memory:  # noqa: ANN401
    memory, pace = sensor.begin(shared, own, start), _pace(sensor, shared)
    if pace is None:
        return memory
    # Until its second reading is there, it gives the first: the robot stood still before the episode.
    first = sensor.observe(shared, own, memory, start)
    return _Kept(memory, {name: jnp.stack([value] * pace.slots) for name, value in first.items()})


def _feel(sensor: Sensor[Any], shared: Any, own: Any, memory: Memory, drive: Drive) -> Memory:  # noqa: ANN401
    pace = _pace(sensor, shared)
    if pace is None:
        return sensor.feel(shared, own, memory, drive)
    after, now = sensor.feel(shared, own, memory.memory, drive), drive.after
    due, slot = now.step % pace.stride == 0, now.step // pace.stride % pace.slots
    fresh = sensor.observe(shared, own, after, now)
    readings = {name: jnp.where(due, kept.at[slot].set(fresh[name]), kept) for name, kept in memory.readings.items()}
    return _Kept(after, readings)


def _observe(sensor: Sensor[Any], shared: Any, own: Any, memory: Memory, now: Situation) -> Fields:  # noqa: ANN401
    pace = _pace(sensor, shared)
    if pace is None:
        return sensor.observe(shared, own, memory, now)
    slot = jnp.maximum(now.step - pace.latency_steps, 0) // pace.stride % pace.slots
    return {name: kept[slot] for name, kept in memory.readings.items()}


def blank_fields(program: Sensors) -> Fields:
    """Returns what the sensors give before anything runs, to check a controller with."""
    return {
        name: value
        for sensor, declared in zip(SENSORS, program, strict=True)
        if declared is not None
        for name, value in sensor.blank(declared).items()
    }


def _shared(program: Sensors, episode: Sensors) -> Iterator[tuple[str, object, object]]:
    """Yields what a program's and an episode's sensors must have in common, by name."""
    each = list(zip(SENSORS, program, episode, strict=True))
    for sensor, one, other in each:
        names = (*sensor.shared, *(name for name in _PACE_LIMITS if name in sensor.kind._fields))
        for name in names if one is not None and other is not None else ():
            yield f"{sensor.name}.{name}", _values(one, name), _values(other, name)
    for sensor, one, other in each:
        yield sensor.name, one is not None, other is not None


def _values(declared: object, name: str) -> object:
    """Returns a number of a sensor; of a list of cameras that of each."""
    values = [getattr(each, name) for each in _members(declared)]
    return values[0] if len(values) == 1 else values


def _filled(sensor: Sensor[Any], declared: object) -> Any:  # noqa: ANN401 - the sensor's own tuple
    """Returns the sensor's tuple with what a bundle declares; None for what is missing and has no default."""
    kind = sensor.kind
    values = {name: getattr(declared, name, kind._field_defaults.get(name)) for name in kind._fields}
    return kind(**values | {name: kind._field_defaults[name] for name in _OF_LISTS & values.keys()})


def _filled_all(sensor: Sensor[Any], declared: object) -> Any:  # noqa: ANN401 - the sensor's own tuple
    """Returns the same, of a list of cameras the first, which has the others."""
    first, *others = (_filled(sensor, one) for one in _members(declared))
    if not others:
        return first
    named = [
        one._replace(name=str(getattr(own, "name", "")))
        for one, own in zip((first, *others), _members(declared), strict=True)
    ]
    return named[0]._replace(others=tuple(named[1:]))


def _faults(sensor: Sensor[Any], declared: Any) -> Iterator[str]:  # noqa: ANN401 - the sensor's own tuple
    for name, value in declared._asdict().items():
        if name in _OF_LISTS:
            continue
        least, most = {**_PACE_LIMITS, **sensor.limits}.get(name, _NOT_NEGATIVE)
        number, whole = _number(value), _whole(sensor, name)
        if number is None or not least <= number <= most or (whole and number % 1):
            shown = "missing" if value is None else repr(value)
            kind = "a whole number" if whole else "a number"
            yield f"controller.{sensor.name}.{name}: {shown}: must be {kind} from {least:g} to {most:g}"


def _whole(sensor: Sensor[Any], name: str) -> bool:
    return name in sensor.whole or name == _PACE_WHOLE


def _number(value: object) -> float | None:
    """Returns a scalar as a number, or None for whatever else a bundle has there."""
    if isinstance(value, str):
        return None
    try:
        number = float(cast("float", value))
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _plain(sensor: Sensor[Any], declared: Any) -> Any:  # noqa: ANN401 - the sensor's own tuple
    if declared is None:
        return None
    pairs = ((name, each) for name, each in declared._asdict().items() if name not in _OF_LISTS)
    numbers = {name: int(each) if _whole(sensor, name) else float(each) for name, each in pairs}
    if not hasattr(declared, "others"):
        return sensor.kind(**numbers)
    return sensor.kind(**numbers, name=declared.name, others=tuple(_plain(sensor, one) for one in declared.others))
