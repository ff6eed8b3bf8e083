"""An episode to be played back: what the robot did in each step, and where it should go.

A replay is compared with what was recorded, column by column, to the last bit.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Float, Int, UInt8

from specs.base import Spec
from specs.bundle_files import CameraDeclaration
from specs.data.episode import EpisodeRequest, EpisodeResult, success
from specs.data.robot_shape import RobotPart
from tasks.results.tables.episode_tables import failures_table, results_table


@dataclass(frozen=True)
class Sight:
    """A lidar.

    Attributes:
        mount: Where it is on the robot: (x m, y m, yaw rad).
        height_m: Of its plane above the floor.
        range_m: What it reports where nothing is nearer.
        angles_rad: The rays' directions in its own frame.
    """

    mount: tuple[float, float, float]
    height_m: float
    range_m: float
    angles_rad: Float[np.ndarray, "rays"]


@dataclass(frozen=True)
class CameraFilm:
    """What a camera saw, or what those of a list saw, one above the other.

    Attributes:
        t_s: When pictures were taken: some of all.
        pictures: Of each pixel its depth in metres, the camera's range where it sees nothing; or red, green and blue.
    """

    camera: CameraDeclaration
    t_s: Float[np.ndarray, "pictures"]
    pictures: Float[np.ndarray, "pictures rows columns"] | UInt8[np.ndarray, "pictures rows columns 3"]

    @property
    def apart(self) -> tuple["CameraFilm", ...]:
        """Returns what each camera of a list saw; of one alone itself."""
        if not self.camera.others:
            return (self,)
        rows = self.camera.rows
        each = enumerate((self.camera.model_copy(update={"others": ()}), *self.camera.others))
        return tuple(CameraFilm(one, self.t_s, self.pictures[:, at * rows : (at + 1) * rows]) for at, one in each)


class BoxFilm(NamedTuple):
    """Boxes that were put into the world of an episode.

    Attributes:
        sizes_m: Of each: along x, along y, and how high.
        places_m: Where each stands at each sample (x, y); far away, where it does not.
        there: Whether it does.
    """

    sizes_m: tuple[tuple[float, float, float], ...]
    places_m: Float[np.ndarray, "samples boxes 2"]
    there: Bool[np.ndarray, "samples boxes"]

    def standing(self, sample: int) -> Iterator[tuple[tuple[float, float], tuple[float, float, float]]]:
        """Yields where each box stands that is there at a sample (x, y), and how large it is."""
        for (x_m, y_m), size_m, there in zip(
            self.places_m[sample].tolist(), self.sizes_m, self.there[sample].tolist(), strict=True
        ):
            if there:
                yield (x_m, y_m), size_m


@dataclass(frozen=True)
class Playback:
    """An episode, sampled at the beginning of each control step, and in the state in which it ended.

    Attributes:
        job: ``<batch>/<index>``.
        ending: How it ended, in a word or two.
        goals_m: Where the robot should go, in order.
        arrived_m: How near counts as reached; None where goals are no destinations.
        radius_m: Of the robot's hull.
        heights_m: Where its hull begins and ends above the floor.
        t_s: Simulated time since the episode began.
        pose: Of the robot's base: (x m, y m, yaw rad).
        velocity: The same a second.
        goal_index: How many goals were reached.
        acted: Whether a scan was seen and a control decided: not where the episode ended.
        impulse_ns: What contacts pushed the robot with until the next sample.
        people_m: Where people are (x, y); without any, none.
        robots_m: Where other robots are (x, y), of the same hull; without any, none.
        shape: What the robot looks like, the lowest part first; without any it is drawn as a disc.
        boxes: What was put into its world; None for nothing.
        depth, color: What its depth camera and its colour camera saw; None for a robot without.
    """

    job: str
    ending: str
    goals_m: Float[np.ndarray, "goals 2"]
    arrived_m: float | None
    radius_m: float
    heights_m: tuple[float, float]
    sight: Sight
    t_s: Float[np.ndarray, "samples"]
    pose: Float[np.ndarray, "samples 3"]
    velocity: Float[np.ndarray, "samples 3"]
    goal_index: Int[np.ndarray, "samples"]
    acted: Bool[np.ndarray, "samples"]
    control: Float[np.ndarray, "samples actuators"]
    ranges_m: Float[np.ndarray, "samples rays"]
    impulse_ns: Float[np.ndarray, "samples"]
    people_m: Float[np.ndarray, "samples people 2"]
    robots_m: Float[np.ndarray, "samples robots 2"]
    shape: tuple[RobotPart, ...] = ()
    boxes: BoxFilm | None = None
    depth: CameraFilm | None = None
    color: CameraFilm | None = None

    @property
    def duration_s(self) -> float:
        """Returns how long it took."""
        return float(self.t_s[-1])

    def touches(self) -> Int[np.ndarray, "touches"]:
        """Returns the samples in which a contact began."""
        pushed = self.impulse_ns > 0.0
        return np.flatnonzero(pushed & ~np.concatenate([[False], pushed[:-1]]))

    def every(self, stride: int) -> Int[np.ndarray, "shown"]:
        """Returns every so many samples, and the last."""
        last = len(self.t_s) - 1
        return np.unique(np.append(np.arange(0, last, stride), last))

    def seen_m(self, sample: int) -> Float[np.ndarray, "rays 2"]:
        """Returns where the rays of a sample ended, in the world."""
        x, y, yaw = (float(each) for each in self.pose[sample])
        along, across, turn = self.sight.mount
        cos, sin = np.cos(yaw), np.sin(yaw)
        at = np.array([x + cos * along - sin * across, y + sin * along + cos * across])
        angles = self.sight.angles_rad + yaw + turn
        return at + self.ranges_m[sample][:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


# Says where the recording lies, and nothing of what happened.
_PLACE = "recording"


class ColumnDeviation(Spec):
    """One column of what was recorded, beside the same column of the replay.

    Attributes:
        column: Its name; ``recording.`` and a name for one of the recording.
        unit: Its unit, or empty.
        recorded: Its value for a person; of a recording how many samples there are.
        replayed: The same of the replay.
        same: Whether all of it is the same, to the last bit.
        most: The largest difference of two numbers; infinite where there is no such thing, as between two words.
    """

    column: str
    unit: str
    recorded: str
    replayed: str
    same: bool
    most: float


def row_deviations(
    recorded: pa.Table, batch_id: str, request: EpisodeRequest, row: EpisodeResult
) -> list[ColumnDeviation]:
    """Returns each column of an episode's row beside the replay's.

    Args:
        recorded: The row of results.parquet or failures.parquet. Columns that this version does not know are left out.
        batch_id: The batch.
        request: What the episode was asked for.
        row: What came of it this time.
    """
    table = failures_table if "trajectory_t_s" in recorded.column_names and success(row) is False else results_table
    again = table(batch_id, [request], [row])
    names = [name for name in recorded.column_names if name != _PLACE and name in again.column_names]
    return [_deviation(name, name, recorded, again) for name in names]


def recording_deviations(recorded: pa.Table, again: pa.Table) -> list[ColumnDeviation]:
    """Returns each column of an episode's recording beside the replay's."""
    names = [name for name in recorded.column_names if name in again.column_names]
    return [_deviation(f"recording.{name}", name, recorded, again) for name in names]


def _deviation(shown: str, name: str, recorded: pa.Table, again: pa.Table) -> ColumnDeviation:
    before, after = recorded.column(name).to_pylist(), again.column(name).to_pylist()
    metadata = cast("Mapping[bytes, bytes]", again.schema.field(name).metadata or {})
    # As text, so that -0.0 is not 0.0, and what is no number is itself.
    same = repr(before) == repr(after)
    return ColumnDeviation(
        column=shown,
        unit=metadata.get(b"unit", b"").decode(),
        recorded=_text(before),
        replayed=_text(after),
        same=same,
        most=0.0 if same else _largest_difference(before, after),
    )


def _text(values: Sequence[object]) -> str:
    if len(values) != 1:
        return f"{len(values)} samples"
    value = values[0]
    if isinstance(value, list):
        number = len(cast("list[object]", value))
        return f"{number} value" if number == 1 else f"{number} values"
    if isinstance(value, bytes):
        return f"a picture of {len(value)} bytes"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _largest_difference(before: object, after: object) -> float:
    """Returns the largest difference of two numbers at the same place; infinite if the rest is not the same."""
    apart = [abs(one - other) for one, other in _pairs(before, after)]
    return max((each if not math.isnan(each) else math.inf for each in apart), default=math.inf)


def _pairs(before: object, after: object) -> Iterator[tuple[float, float]]:
    if isinstance(before, list | tuple) and isinstance(after, list | tuple):
        ours, theirs = cast("Sequence[object]", before), cast("Sequence[object]", after)
        yield from _paired_items(ours, theirs) if len(ours) == len(theirs) else [(0.0, math.inf)]
    elif isinstance(before, int | float) and isinstance(after, int | float) and not isinstance(before, bool):
        yield before, after
    elif before != after:
        yield 0.0, math.inf


def _paired_items(before: Iterable[object], after: Iterable[object]) -> Iterator[tuple[float, float]]:
    for one, other in zip(before, after, strict=True):
        yield from _pairs(one, other)
