"""The columns of the result tables: each a record with its type, unit, meaning, and how it is made from episodes.

Everything else follows from these records: the Parquet schemas and rows (``tasks.results.tables``), the measures that a
gate's quantile may ask for, and the tables of docs/reference/results-schema.md.

To add a column, add a `Column` below and raise ``SCHEMA_VERSION``.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from specs.data.outcomes import OUTCOME_REASONS
from specs.data.physics import varied_people

if TYPE_CHECKING:  # who checks a document needs the names of columns, and no NumPy
    import numpy as np

    from specs.data.episode_columns import Cells, EpisodeColumns, RequestColumns

SCHEMA_VERSION = "10"
"""Of names, types and meanings: they change only together with it."""

ColumnType = Literal[
    "string",
    "int32",
    "int64",
    "double",
    "bool",
    "list<double>",
    "list<string>",
    "map<string, double>",
    "map<string, string>",
]


Course = Literal["", "grows", "falls"]


class BatchColumns(NamedTuple):
    """What rows are made from: episodes of a batch in their order, with what was asked for and what came of each."""

    batch: str
    requests: "RequestColumns"
    results: "EpisodeColumns"


class Column(NamedTuple):
    """A column of a result table.

    Attributes:
        name: With its unit as suffix.
        type: The Arrow type.
        unit: Such as ``m``; empty for none.
        meaning: A sentence for the file's metadata and the documentation.
        cells: Makes the column of some episodes.
        nullable: Whether a value may be missing.
        measure: Whether it measures the episode with one number, so that a gate may ask for a quantile of it.
        course: What time makes of it while an episode goes on. Who ends early has less of what grows, and more of what
            falls, and so looks better than it is.
    """

    name: str
    type: ColumnType
    unit: str
    meaning: str
    cells: "Callable[[BatchColumns], Cells]"
    nullable: bool = False
    measure: bool = False
    course: Course = ""


def _requested(name: str, kind: ColumnType, unit: str, meaning: str) -> Column:
    """Returns a column that is a field of the request; index, seed and world have their own."""
    return Column(name, kind, unit, meaning, _shared(attrgetter(name)))


def _shared(value: Callable[[EpisodeRequest], object]) -> "Callable[[BatchColumns], Cells]":
    """Returns what makes a column of something that many requests share."""
    return lambda episodes: episodes.requests.shared(value)


def _people_there(request: EpisodeRequest) -> int:
    """Returns how many people walk in an episode, whose variables may say so."""
    people = varied_people(request.people, request.environment)
    return people.count if people else 0


def _field(name: str) -> "Callable[[BatchColumns], Cells]":
    """Returns what makes the column of a field of the result."""
    return lambda episodes: episodes.results.cells[name]


def _of_ending(value: Callable[[EpisodeResult], object]) -> "Callable[[BatchColumns], Cells]":
    """Returns what makes a column of something that follows from how an episode ended."""
    return lambda episodes: episodes.results.of_ending(value)


def _answered(name: str, kind: ColumnType, unit: str, meaning: str) -> Column:
    """Returns a column that is a field of the result."""
    return Column(name, kind, unit, meaning, _field(name))


def _measured(
    name: str, kind: ColumnType, unit: str, meaning: str, *, nullable: bool = False, course: Course = ""
) -> Column:
    """Returns a column that is a field of the result; a gate may ask for it if it is a number."""
    measure = kind in {"int32", "double"}
    return Column(name, kind, unit, meaning, _field(name), nullable, measure, course)


def _launch(prefix: str, what: str, field: str) -> tuple[Column, ...]:
    """Returns the columns of an application that took part; ``field`` is the request's field."""

    def part(suffix: str, attribute: str, meaning: str) -> Column:
        return Column(f"{prefix}_{suffix}", "string", "", meaning, _shared(attrgetter(f"{field}.{attribute}")))

    return (
        part("application", "name", f"Name of the {what} application."),
        part("version", "version", "Its version as asked for: a number, or $LATEST."),
        part("digest", "digest", "SHA-256 of its bundle, lower-case hex: what really ran."),
        part("package", "package", "packageName of its launch configuration."),
        part("launch_file", "launched", "launchFile of its launch configuration."),
    )


def _trajectory(name: str, axis: int, unit: str, meaning: str) -> Column:
    """Returns a column with one number of each pose of the trajectory (t_s, x_m, y_m, yaw_rad)."""

    def cells(episodes: BatchColumns) -> "Cells":
        poses = episodes.results.cells["trajectory"]
        return poses._replace(numbers=cast("np.ndarray", poses.numbers)[:, axis])

    return Column(name, "list<double>", unit, meaning, cells)


def _batch(episodes: BatchColumns) -> "Cells":
    return episodes.requests.shared(lambda _: episodes.batch)


def _jobs(episodes: BatchColumns) -> "Cells":
    return episodes.requests.named(f"{episodes.batch}/")


REQUESTED = (
    Column("batch", "string", "", "Id of the simulation job batch.", _batch),
    Column(
        "job",
        "string",
        "",
        "Id of the simulation job, <batch>/<index>; the last part of its ARN.",
        _jobs,
    ),
    Column(
        "index",
        "int32",
        "",
        "Position of the job in the batch, from 0.",
        lambda episodes: episodes.requests.number_cells("index"),
    ),
    Column("world", "string", "", "The world, <generation>/<name>.", lambda episodes: episodes.requests.worlds),
    Column(
        "seed",
        "int64",
        "",
        "Seed that draws the scenario's goals and the sensors' noise.",
        lambda episodes: episodes.requests.number_cells("seeds"),
    ),
    *_launch("robot", "robot", "robot"),
    *_launch("simulation", "simulation", "scenario"),
    Column(
        "environment",
        "map<string, string>",
        "",
        "Environment variables, sorted by name; simulation:NAME is one that the simulation application has otherwise.",
        _shared(lambda request: tuple(sorted(request.told_variables.items()))),
    ),
    _requested("duration_s", "double", "s", "Simulated time at most (maxJobDurationInSeconds)."),
    Column(
        "people",
        "int32",
        "",
        "How many people walk in the world.",
        _shared(_people_there),
    ),
    Column(
        "boxes",
        "int32",
        "",
        "How many boxes are put into the world while the robot drives.",
        _shared(lambda request: len(request.boxes or ())),
    ),
    Column(
        "robots",
        "int32",
        "",
        "How many robots share the world, each with a row of its own.",
        _shared(lambda request: request.sharing),
    ),
    Column("robot", "int32", "", "Which of them this one is, from 0.", _shared(attrgetter("number"))),
    _requested("failure_behavior", "string", "", "What a crash does to the job: Fail or Continue."),
)
"""What was asked for."""

_REASONS = ", ".join(each.name for each in OUTCOME_REASONS)
ANSWERED = (
    _answered("status", "string", "", "RoboMaker's job status: Completed, Failed or Canceled."),
    _answered("failure_code", "string", "", "RoboMaker's failure code, or empty."),
    _answered("outcome", "string", "", "Whether the robot did its task, as the scenario judges: Passed or Failed."),
    _answered("outcome_reason", "string", "", f"Why not: {_REASONS}; or empty."),
    Column(
        "success",
        "bool",
        "",
        "Completed and Passed: what the gate counts; null for Canceled.",
        _of_ending(success),
        nullable=True,
    ),
    _answered(
        "engine", "string", "", "What drove the robot: planar, mjx or mujoco; empty if it did not start or was stopped."
    ),
    _answered("device", "string", "", "The kind of device that it ran on, cpu or gpu; empty like engine."),
    _answered(
        "recording", "string", "", "File below recordings/<batch>/ that holds the episode's recording, or empty."
    ),
)
"""How it ended."""

EXPLAINED = (
    Column(
        "reason",
        "string",
        "",
        "The failure code of a job that failed, else the outcome's reason; to group by.",
        _of_ending(reason),
    ),
    _answered("failure_reason", "string", "", "What happened, for a person, or empty."),
    _trajectory("trajectory_t_s", 0, "s", "Times of the downsampled trajectory."),
    _trajectory("trajectory_x_m", 1, "m", "Its positions, x."),
    _trajectory("trajectory_y_m", 2, "m", "Its positions, y."),
    _trajectory("trajectory_yaw_rad", 3, "rad", "Its headings, counter-clockwise from +x."),
)
"""Why it failed; in ``failures.parquet`` alone."""

_SHORTEST = (
    "Length of the shortest way from the start to where each goal counts as reached, in order, for a disc of the "
    "robot's radius; null where there is none, or where goals are no destinations."
)
_SPL = "Success weighted by path length, 0 to 1 (Anderson et al. 2018, arXiv:1807.06757); null without a shortest way."
_ENTERED = "Names of the rooms that the robot's position was in, in the order in which it came to them."
_UNREACHABLE = (
    "Names of the rooms that a disc of the robot's radius cannot get to from the start, doors as they stand; rooms "
    "that it entered are never among them."
)
_REACHABLE = "How many of the goals such a disc can get to; null where goals are no destinations."
_ODOMETRY = "How far the place that the robot believed in was from its final one; null for a robot without odometry."
_LATE = (
    "Stages of control steps at which a ROS application did not come to rest in time, or two of its processes told a "
    "third one something; and datagrams to nodes of ROS 2 or their robot that were dropped; null for other robots."
)
_STRAY = (
    "Commands and places that a ROS application gave its robot after it was taken for quiet; null for other robots."
)
_PERSON_CONTACTS = (
    "Control steps in which a contact with a person began, which is none of collisions; null without people, as the "
    "columns of people that follow."
)
_STANDING_CONTACTS = (
    "Those of them that began while the robot stood still, slower than 0.02 m/s: a person walked into it."
)
_PERSON_SPEED = "Highest speed of robot and person against each other at which such a contact began; 0 without any."
_PERSON_ENERGY = (
    "The most energy that such a contact, of a robot that did not stand still, put into a body region at the hull's "
    "heights, by the model of ISO/TS 15066:2016, annex A: mu v^2 / 2; 0 without any."
)
_PERSON_FORCE = "The highest force of such a contact on a region, v sqrt(mu k), or of pressing on after 0.5 s."
_PERSON_MARGIN = (
    "1 less the highest share that such a force has of its region's limit: the transient one, or the quasi-static one "
    "of a person who is pinned before a solid, or pressed; 1 without any, below 0 above the limit."
)
_COLLISION_TIME = (
    "Smallest time until disc and person would touch if both kept their velocities (Hayward 1972); 0 in contact, 60 "
    "where they never would within a minute."
)
_FROZEN = "Longest time in which the robot stood still, slower than 0.02 m/s, within 1.2 m of a person."
_PERSON_DISTANCE = "Smallest distance, seen from above, from the hull to a person; below 0 only in contact."
_PERSONAL = "Simulated time within 1.2 m of a person, the personal distance of Hall (1966)."
_INTIMATE = "Simulated time within 0.45 m of a person, his intimate distance."
_ROBOT_CONTACTS = (
    "Control steps in which a contact with another robot began, which is none of collisions; null for a robot alone, "
    "as the two columns that follow."
)
_ROBOT_SPEED = "Highest speed of both robots against each other at which such a contact began; 0 without any."
_ROBOT_DISTANCE = (
    "Smallest distance, seen from above, from the circle around the hull to another robot's; below 0 only in contact."
)
_CLEARANCE = "Smallest distance, seen from above, from the hull to a solid at its heights; below 0 only in contact."
MEASURED = (
    _measured("simulated_s", "double", "s", "Simulated time until the episode ended.", course="grows"),
    _measured("goals_reached", "int32", "", "How many of the scenario's goals were reached.", course="grows"),
    _measured("goals_total", "int32", "", "How many goals there were."),
    _measured("goal_times_s", "list<double>", "s", "When each goal that was reached was reached, in their order."),
    _measured("path_length_m", "double", "m", "Length of the driven path.", course="grows"),
    _measured("shortest_path_m", "double", "m", _SHORTEST, nullable=True),
    _measured("spl", "double", "", _SPL, nullable=True),
    _measured("collisions", "int32", "", "Control steps in which a contact with a solid began.", course="grows"),
    _measured(
        "impulse_ns", "double", "Ns", "What contacts pushed the robot with in the plane, summed up.", course="grows"
    ),
    _measured("max_impulse_ns", "double", "Ns", "The most of it within one control step of 50 ms.", course="grows"),
    _measured("min_clearance_m", "double", "m", _CLEARANCE, course="falls"),
    _measured("energy_j", "double", "J", "Integral of |actuator force x velocity| over time.", course="grows"),
    _measured("final_x_m", "double", "m", "Final position, x."),
    _measured("final_y_m", "double", "m", "Final position, y."),
    _measured("final_yaw_rad", "double", "rad", "Final heading, counter-clockwise from +x."),
    _measured("odometry_error_m", "double", "m", _ODOMETRY, nullable=True, course="grows"),
    _measured("late", "int32", "", _LATE, nullable=True, course="grows"),
    _measured("stray", "int32", "", _STRAY, nullable=True, course="grows"),
    _measured("person_contacts", "int32", "", _PERSON_CONTACTS, nullable=True, course="grows"),
    _measured("person_standing_contacts", "int32", "", _STANDING_CONTACTS, nullable=True, course="grows"),
    _measured("person_contact_m_s", "double", "m/s", _PERSON_SPEED, nullable=True, course="grows"),
    _measured("person_energy_j", "double", "J", _PERSON_ENERGY, nullable=True, course="grows"),
    _measured("person_force_n", "double", "N", _PERSON_FORCE, nullable=True, course="grows"),
    _measured("person_force_margin", "double", "", _PERSON_MARGIN, nullable=True, course="falls"),
    _measured("min_person_m", "double", "m", _PERSON_DISTANCE, nullable=True, course="falls"),
    _measured("min_person_collision_s", "double", "s", _COLLISION_TIME, nullable=True, course="falls"),
    _measured("person_personal_s", "double", "s", _PERSONAL, nullable=True, course="grows"),
    _measured("person_intimate_s", "double", "s", _INTIMATE, nullable=True, course="grows"),
    _measured("person_frozen_s", "double", "s", _FROZEN, nullable=True, course="grows"),
    _measured("robot_contacts", "int32", "", _ROBOT_CONTACTS, nullable=True, course="grows"),
    _measured("robot_contact_m_s", "double", "m/s", _ROBOT_SPEED, nullable=True, course="grows"),
    _measured("min_robot_m", "double", "m", _ROBOT_DISTANCE, nullable=True, course="falls"),
    _answered("rooms_entered", "list<string>", "", _ENTERED),
    _answered("rooms_unreachable", "list<string>", "", _UNREACHABLE),
    _answered("rooms_total", "int32", "", "How many rooms the world has; 0 if the episode did not start."),
    _measured("goals_reachable", "int32", "", _REACHABLE, nullable=True),
    _measured("metrics", "map<string, double>", "", "What the scenario measures by itself, by name."),
)
"""What was measured."""

RESULTS_COLUMNS = (*REQUESTED, *ANSWERED, *MEASURED)
"""Of ``results.parquet``: a row an episode."""
FAILURES_COLUMNS = (*REQUESTED, *ANSWERED, *EXPLAINED, *MEASURED)
"""Of ``failures.parquet``: a row an episode that did not pass."""

MEASURES = tuple(column.name for column in RESULTS_COLUMNS if column.measure)
"""What a gate's quantile may be of, besides ``metrics.<name>`` for what the scenario measures."""

MEASURES_OF_MOVERS = {
    "people": tuple(name for name in MEASURES if name.startswith(("person_", "min_person_"))),
    "robots": tuple(name for name in MEASURES if name.startswith(("robot_", "min_robot_"))),
}
"""Those that only episodes with people, or with several robots, have."""

COURSES = {column.name: column.course for column in RESULTS_COLUMNS if column.course}
"""What time makes of a measure; those that it leaves alone are not here."""
