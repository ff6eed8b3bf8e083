"""Files of a bundle that declare a robot: its sensors, ``<launch>.yaml`` of a policy, ``image.json`` of an image."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, Self, cast

from pydantic import Field, model_validator

from specs.base import Spec
from specs.field_types import Architecture
from specs.launched_file import is_ros2, names_ros_launch

Length = Annotated[float, Field(ge=0.0, le=1e4)]
Place = Annotated[float, Field(ge=-1e4, le=1e4)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
_MOST_COLUMNS, _MOST_ROWS = 640, 480
Latency = Annotated[int, Field(ge=0, le=20)]


ONE_OF_A_KIND = "a robot has one sensor of this kind, not a list of them; what to do instead: docs/guide/limits.md"
MOST_CAMERAS = 8
# What cameras of a list have in common, so that their pictures are one array.
ALIKE = ("columns", "rows", "range_m", "rate_hz", "latency_steps")


# The fields are those that a controller's own sensors have (docs/guide/applications.md).
class PacedDeclaration(Spec):
    """What sensors have in common that read at a rate of their own.

    Attributes:
        rate_hz: Readings in a simulated second, made a whole fraction of the control rate; 0 for one each control step.
        latency_steps: How many control steps old a reading is when the robot gets it.
    """

    rate_hz: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    latency_steps: Latency = 0

    @model_validator(mode="before")
    @classmethod
    def _no_list(cls, given: object) -> object:
        return cls._one_of(cast("Sequence[object]", given)) if isinstance(given, list | tuple) else given

    @classmethod
    def _one_of(cls, _given: Sequence[object]) -> object:
        raise ValueError(ONE_OF_A_KIND)


class LidarDeclaration(PacedDeclaration):
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
        latency_steps: How many control steps ago they were touched when the robot is told.
    """

    sectors: Annotated[int, Field(ge=1, le=64)] = 3
    latency_steps: Latency = 0


class CameraDeclaration(PacedDeclaration):
    """What cameras of any kind have in common; pixels are square, and the middle of a picture is straight ahead.

    Attributes:
        columns, rows: Of a picture.
        fov_rad: Field of view from its left edge to its right one.
        range_m: What lies farther ahead is not seen.
        x_m, y_m, z_m: Where it is mounted: ahead, to the left, above the floor.
        pitch_rad, yaw_rad: How it is turned: down, counter-clockwise.
        sees_robot: Whether its own robot is in its pictures, as that stands at the start.
        name: Of one in a list of cameras; empty for the only one.
        others: Those behind it in its list, each with a place, a turn and errors of its own.
    """

    columns: Annotated[int, Field(ge=1, le=_MOST_COLUMNS)] = 64
    rows: Annotated[int, Field(ge=1, le=_MOST_ROWS)] = 48
    fov_rad: Annotated[float, Field(ge=0.01, le=3.0)] = 1.2
    range_m: Annotated[float, Field(ge=0.01, le=1e4)] = 10.0
    x_m: Place = 0.0
    y_m: Place = 0.0
    z_m: Length = 0.3
    pitch_rad: Annotated[float, Field(ge=-math.pi / 2, le=math.pi / 2)] = 0.0
    yaw_rad: Place = 0.0
    sees_robot: bool = False
    name: Annotated[str, Field(pattern=r"^([a-z][a-z0-9_]{0,31})?$")] = ""
    others: Annotated[tuple[Self, ...], Field(max_length=MOST_CAMERAS - 1)] = ()

    @classmethod
    def _one_of(cls, given: Sequence[object]) -> object:
        if len(given) < 2 or not all(isinstance(each, Mapping) for each in given):
            raise ValueError(f"a list of cameras has 2 to {MOST_CAMERAS}, each with a name; one alone is no list")
        first, *others = cast("Sequence[Mapping[str, object]]", given)
        return {**first, "others": others}

    @property
    def every(self) -> tuple[Self, ...]:
        """Returns it and those behind it in its list."""
        return self, *self.others

    @property
    def shape(self) -> tuple[int, ...]:
        """Returns the shape of what it shows: rows and columns, after the number of cameras of a list."""
        return (*([len(self.every)] if self.others else []), self.rows, self.columns)

    def own(self, name: str) -> str:
        """Returns a topic or a frame of cameras as this one has it: with its name before it in a list of some."""
        if not self.name:
            return name
        return f"/{self.name}{name}" if name.startswith("/") else f"{self.name}_{name}"

    @model_validator(mode="after")
    def _alike(self) -> Self:
        names = [each.name for each in self.every]
        if self.others and ("" in names or len({*names}) < len(names)):
            raise ValueError("name: each camera of a list has one of its own")
        if any(each.others for each in self.others):
            raise ValueError("others: a camera of a list has none behind it")
        wrong = [name for name in ALIKE if len({getattr(each, name) for each in self.every}) > 1]
        if wrong:
            raise ValueError(f"{', '.join(wrong)}: cameras of a list have the same, and places and turns of their own")
        return self


def fitted_size(columns: int, rows: int) -> tuple[int, int]:
    """Returns the columns and rows of a picture, made smaller alike if a camera here cannot have so many."""
    scale = max(1.0, columns / _MOST_COLUMNS, rows / _MOST_ROWS)
    return max(1, round(columns / scale)), max(1, round(rows / scale))


def facing(ahead: Sequence[float], up: Sequence[float] = (0.0, 0.0, 1.0)) -> tuple[float, float]:
    """Returns how a camera is turned, counter-clockwise and then down, that looks along a vector.

    Args:
        ahead: The vector, of any length.
        up: What is up in its pictures; it tells where one faces that looks straight down or up.
    """
    x, y, z = ahead
    level = math.hypot(x, y)
    pitch = math.atan2(-z, level)
    if level > 1e-6 * abs(z):
        return math.atan2(y, x), pitch
    return math.atan2(-z * up[1], -z * up[0]), pitch


class DepthCameraDeclaration(CameraDeclaration):
    """A depth camera: of each pixel, how far ahead of the camera what it sees lies; ``range_m`` if that is nothing.

    Attributes:
        sigma_m_per_m2: Standard deviation of a depth of 1 m; it grows with the square of the depth.
        baseline_m, disparity_px: From one eye to the other, and the least difference between their pictures that it
            tells apart: depths come in steps that grow with their square. 0 for either: no steps.
        dropout: Probability that a pixel sees nothing.
        edge_dropout, edge_share: Probability that a pixel sees nothing at an edge or on a surface at a grazing angle:
            where the depth beside it, above or below, is nearer or farther by more than this share.
    """

    sigma_m_per_m2: Length = 0.0
    baseline_m: Length = 0.0
    disparity_px: Length = 0.0
    dropout: Share = 0.0
    edge_dropout: Share = 0.0
    edge_share: Share = 0.1


class ColorCameraDeclaration(CameraDeclaration):
    """A colour camera, and the light that it sees by; without any spread all episodes have the same light.

    Attributes:
        light_spread: The lamp of an episode is brighter or darker than usual by up to this share.
        tint_spread: So is each of its three colours, on its own.
        light_tilt_rad: How far from upright it shines at most, in any direction; 0 for the usual direction.
        exposure_spread: A picture is brighter or darker by up to this share.
        blur_px: Standard deviation of the blur.
        noise: Standard deviation of each channel of a pixel, as a share of white.
    """

    range_m: Annotated[float, Field(ge=0.1, le=1e4)] = 100.0
    light_spread: Share = 0.0
    tint_spread: Share = 0.0
    light_tilt_rad: Annotated[float, Field(ge=0.0, le=1.5)] = 0.0
    exposure_spread: Share = 0.0
    blur_px: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    noise: Share = 0.0


class ImuDeclaration(PacedDeclaration):
    """An inertial measurement unit.

    Attributes:
        x_m, y_m, z_m: Where it is mounted, from the base's own origin: ahead, to the left, up.
        yaw_rad: How it is turned, counter-clockwise.
        gyro_sigma_rad_s, force_sigma_m_s2: Standard deviation of a reading of a turn rate, and of specific force.
        gyro_walk_rad_s, force_walk_m_s2: Of how far zeros have walked after a second.
        scale_share: Of an axis's scale, drawn once an episode.
    """

    x_m: Place = 0.0
    y_m: Place = 0.0
    z_m: Place = 0.0
    yaw_rad: Place = 0.0
    gyro_sigma_rad_s: Length = 0.0
    gyro_walk_rad_s: Length = 0.0
    force_sigma_m_s2: Length = 0.0
    force_walk_m_s2: Length = 0.0
    scale_share: Share = 0.0


class RangeFindersDeclaration(PacedDeclaration):
    """Range finders, ultrasonic or infrared: each tells how near the nearest thing is in its cone, the floor apart.

    Attributes:
        finders: How many.
        range_m: What one tells if nothing is nearer.
        z_m: Their height above the floor.
        cone_rad: From one edge of a cone to the other.
        first_rad, apart_rad: Where the first one looks, counter-clockwise from ahead, and from one to the next.
        out_m: How far from the robot's axis they are mounted, each in the direction in which it looks.
        sigma_m: Standard deviation of a distance.
        dropout: Probability that one tells ``range_m`` although something is nearer.
    """

    finders: Annotated[int, Field(ge=1, le=64)] = 1
    range_m: Annotated[float, Field(ge=0.01, le=1e4)] = 4.0
    z_m: Length = 0.2
    cone_rad: Annotated[float, Field(ge=0.01, le=2.0)] = 0.5
    first_rad: Place = 0.0
    apart_rad: Place = 0.0
    out_m: Place = 0.0
    sigma_m: Length = 0.0
    dropout: Share = 0.0


class WheelEncodersDeclaration(PacedDeclaration):
    """Counters of a left and a right wheel that roll as the robot drives, and do not slip.

    Attributes:
        track_m: From one wheel to the other.
        tick_m: Way of a wheel from one count to the next.
        sigma_m_per_m: Standard deviation of a wheel's way, after a metre.
        scale_share: Standard deviation of each wheel's size, as a share of it, drawn once an episode.
    """

    track_m: Length = 0.3
    tick_m: Annotated[float, Field(ge=1e-6, le=1e4)] = 0.001
    sigma_m_per_m: Length = 0.0
    scale_share: Share = 0.0


class CompassDeclaration(PacedDeclaration):
    """A magnetometer, which feels the field of the earth (microtesla) along the robot's axes.

    Attributes:
        north_rad: Where the magnetic north is, counter-clockwise from the world's x axis.
        level_ut, down_ut: How strong the field is along the floor, and downwards.
        sigma_ut: Standard deviation of a reading of an axis.
        bias_ut: Standard deviation of what the robot's own iron adds to an axis, drawn once an episode.
    """

    north_rad: Place = math.pi / 2
    level_ut: Length = 20.0
    down_ut: Place = 45.0
    sigma_ut: Length = 0.0
    bias_ut: Length = 0.0


class CliffSensorsDeclaration(PacedDeclaration):
    """Cliff sensors: each tells how far below it the nearest thing is, the floor among them.

    Attributes:
        sensors: How many.
        range_m: What one tells if nothing is nearer.
        z_m: Their height above the floor that the robot starts on.
        first_rad, apart_rad: Where the first one is, counter-clockwise from ahead, and from one to the next.
        out_m: How far from the robot's axis they are mounted.
        sigma_m: Standard deviation of a distance.
        dropout: Probability that one tells ``range_m`` although something is nearer, as above a dark floor.
    """

    sensors: Annotated[int, Field(ge=1, le=64)] = 3
    range_m: Annotated[float, Field(ge=0.01, le=1e4)] = 0.3
    z_m: Length = 0.05
    first_rad: Place = -0.6
    apart_rad: Place = 0.6
    out_m: Place = 0.15
    sigma_m: Length = 0.0
    dropout: Share = 0.0


class GpsDeclaration(PacedDeclaration):
    """A receiver of satellites, and where the world's origin is on the earth; x is east, y north.

    Attributes:
        latitude_deg, longitude_deg, altitude_m: Of the world's origin.
        x_m, y_m, z_m: Where the antenna is: ahead, to the left, above the floor that the robot starts on.
        sigma_m: Standard deviation of each coordinate, anew at each reading; twice as much upwards.
        drift_m: Standard deviation of an error that changes slowly; twice as much upwards.
        drift_s: Time after which the slow error is forgotten to a share of 1/e.
    """

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 0.0
    altitude_m: Place = 0.0
    x_m: Place = 0.0
    y_m: Place = 0.0
    z_m: Place = 0.0
    sigma_m: Length = 0.0
    drift_m: Length = 0.0
    drift_s: Annotated[float, Field(ge=0.1, le=1e4)] = 60.0


class SensorDeclarations(Spec):
    """The sensors of a robot whose controller is no Python; None for one that it has not."""

    lidar: LidarDeclaration | None = None
    odometry: OdometryDeclaration | None = None
    bumper: BumperDeclaration | None = None
    depth_camera: DepthCameraDeclaration | None = None
    imu: ImuDeclaration | None = None
    range_finders: RangeFindersDeclaration | None = None
    wheel_encoders: WheelEncodersDeclaration | None = None
    compass: CompassDeclaration | None = None
    cliff_sensors: CliffSensorsDeclaration | None = None
    gps: GpsDeclaration | None = None


class SeeingDeclarations(SensorDeclarations):
    """Sensors of a robot that is driven on the host, which draws what its ``color_camera`` sees; None for none."""

    color_camera: ColorCameraDeclaration | None = None


MOST_FRAMES = 64
PolicyField = Literal[
    "ranges_m",
    "goal_robot_m",
    "goal_m",
    "goal_index",
    "pose",
    "velocity",
    "bumper",
    "time_s",
    "depth_m",
    "turn_rad_s",
    "force_m_s2",
    "finder_m",
    "ticks",
    "field_ut",
    "cliff_m",
    "gps_m",
    "color",
    "qpos",
    "qvel",
]
Name = Annotated[str, Field(min_length=1, max_length=255)]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]


class PolicyPart(Spec):
    """A field of the observation, as a policy is shown it: ``clip(field * scale + offset, low, high)``.

    Attributes:
        field: Its name (docs/guide/applications.md); ``qpos`` and ``qvel`` are those of ``joints``.
        scale, offset: What it is multiplied with, and what is added then.
        low, high: Between which the result is held; None for no bound.
        frames: How many control steps' results it is shown, the newest last, an episode's first repeated.
    """

    field: PolicyField
    scale: Number = 1.0
    offset: Number = 0.0
    low: Number | None = None
    high: Number | None = None
    frames: Annotated[int, Field(ge=1, le=MOST_FRAMES)] = 1

    @model_validator(mode="after")
    def _bounds_in_order(self) -> Self:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low} is above high {self.high}")
        return self


class PolicyInput(Spec):
    """An input of the network: some parts, one after the other.

    Attributes:
        name: Of the input; None for the only one that is not kept.
        parts: In their order.
    """

    name: Name | None = None
    parts: Annotated[tuple[PolicyPart, ...], Field(min_length=1, max_length=64)]


class PolicyState(Spec):
    """What a recurrent network keeps, for each lane: the output of one control step is the input of the next.

    It begins with zeros. Its dimension of the lanes is the one that the network leaves open.

    Attributes:
        input, output: Their names.
    """

    input: Name
    output: Name


class ActionOutput(Spec):
    """The answer is an action from -1 to 1, clipped, over the ``ctrlrange`` of each actuator that has one.

    Attributes:
        name: Of the output; None for the only one that is not kept.
    """

    kind: Literal["action"] = "action"
    name: Name | None = None


class ControlsOutput(Spec):
    """The answer is the control itself: one number for each actuator, or for each that has a ``ctrlrange``.

    Attributes:
        name: Of the output; None for the only one that is not kept.
    """

    kind: Literal["controls"]
    name: Name | None = None


class ChoiceOutput(Spec):
    """The answer is a score for each of some controls: the highest is taken, the first of equals.

    Attributes:
        name: Of the output; None for the only one that is not kept.
        controls: One number for each actuator, or for each that has a ``ctrlrange``.
    """

    kind: Literal["choice"]
    name: Name | None = None
    controls: Annotated[
        tuple[Annotated[tuple[Number, ...], Field(min_length=1, max_length=256)], ...],
        Field(min_length=1, max_length=4096),
    ]


PolicyOutput = Annotated[ActionOutput | ControlsOutput | ChoiceOutput, Field(discriminator="kind")]


class Policy(SeeingDeclarations):
    """A network that drives a robot, and the robot's sensors.

    Attributes:
        inputs: What the network is shown.
        states: What it keeps.
        output: What its answer means.
    """

    inputs: Annotated[tuple[PolicyInput, ...], Field(min_length=1, max_length=64)]
    states: Annotated[tuple[PolicyState, ...], Field(max_length=64)] = ()
    output: PolicyOutput = ActionOutput()


class ContainerImage(Spec):
    """A container image as an application, as ``image.json`` in its bundle tells of it.

    Attributes:
        digest: SHA-256 of the image's manifest.
        architecture: That it is built for.
        entrypoint, command: What is run, as the image has it; a launch configuration replaces the command.
        environment: Variables that it sets.
        folder: Where it is run.
        user, group: As whom, by number.
        ros: 1 or 2, by what lies in it; 0 where neither does.
    """

    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    architecture: Architecture
    entrypoint: tuple[str, ...] = ()
    command: tuple[str, ...] = ()
    environment: dict[str, str] = Field(default_factory=dict[str, str])
    folder: Annotated[str, Field(pattern="^/")] = "/"
    user: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    group: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    ros: Annotated[int, Field(ge=0, le=2)] = 0

    def words(self, package: str, launch_file: str, command: Sequence[str] | None = None) -> tuple[str, ...]:
        """Returns what is run: the entry point, then what a launch configuration says, or else the image's own command.

        Args:
            package: The launch configuration's packageName.
            launch_file: Its launchFile: a launch file of ROS, or a program in that folder of the image.
            command: Its command, for one without a launchFile.
        """
        if names_ros_launch(launch_file):
            program = ("ros2", "launch") if is_ros2(launch_file) else ("roslaunch",)
            return (*self.entrypoint, *program, package, launch_file)
        return (*self.entrypoint, *((f"/{package}/{launch_file}",) if launch_file else command or self.command))
