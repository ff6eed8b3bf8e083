"""The columns of the result tables, with their meanings: docs/reference/results-schema.md is made of them.

``RESULTS`` has a row an episode; ``FAILURES`` a row an episode that did not pass, the same columns and why. Both get
one more column for each environment variable that is a number everywhere (`sweep_field`). Names, types and meanings
change only together with ``SCHEMA_VERSION``.
"""

import pyarrow as pa

SCHEMA_VERSION = "3"
SWEEP_PREFIX = "env_"

_TEXT, _WHOLE, _COUNT, _REAL, _FLAG = pa.string(), pa.int64(), pa.int32(), pa.float64(), pa.bool_()
_WORDS = pa.map_(pa.string(), pa.string())
_MEASURES = pa.map_(pa.string(), pa.float64())
_REALS = pa.list_(pa.float64())


def column(name: str, kind: pa.DataType, unit: str, meaning: str, *, nullable: bool = False) -> pa.Field:
    """Returns a column with its unit (empty for none) and meaning as metadata."""
    return pa.field(name, kind, nullable=nullable, metadata={"unit": unit, "description": meaning})


def sweep_field(variable: str) -> pa.Field:
    """Returns the column of an environment variable that is a number in every episode that has it."""
    meaning = f"Environment variable {variable} as a number; null where it is not set."
    return column(f"{SWEEP_PREFIX}{variable}", _REAL, "", meaning, nullable=True)


def _launch(prefix: str, what: str) -> list[pa.Field]:
    return [
        column(f"{prefix}_application", _TEXT, "", f"Name of the {what} application."),
        column(f"{prefix}_version", _TEXT, "", "Its version as asked for: a number, or $LATEST."),
        column(f"{prefix}_digest", _TEXT, "", "SHA-256 of its bundle, lower-case hex: what really ran."),
        column(f"{prefix}_package", _TEXT, "", "packageName of its launch configuration."),
        column(f"{prefix}_launch_file", _TEXT, "", "launchFile of its launch configuration."),
    ]


REQUESTED = [
    column("batch", _TEXT, "", "Id of the simulation job batch."),
    column("job", _TEXT, "", "Id of the simulation job, <batch>/<index>; the last part of its ARN."),
    column("index", _COUNT, "", "Position of the job in the batch, from 0."),
    column("world", _TEXT, "", "The world, <generation>/<name>."),
    column("seed", _WHOLE, "", "Seed that draws the scenario's goals and the sensors' noise."),
    *_launch("robot", "robot"),
    *_launch("simulation", "simulation"),
    column("environment", _WORDS, "", "Environment variables, sorted by name."),
    column("duration_s", _REAL, "s", "Simulated time at most (maxJobDurationInSeconds)."),
    column("failure_behavior", _TEXT, "", "What a crash does to the job: Fail or Continue."),
]

_SHORTEST = (
    "Length of the shortest way from the start to where each goal counts as reached, in order, for a disc of the "
    "robot's radius; null where there is none, or where goals are no destinations."
)
_SPL = "Success weighted by path length, 0 to 1 (Anderson et al. 2018, arXiv:1807.06757); null without a shortest way."
_ODOMETRY = "How far the place that the robot believed in was from its final one; null for a robot without odometry."
MEASURED = [
    column("simulated_s", _REAL, "s", "Simulated time until the episode ended."),
    column("goals_reached", _COUNT, "", "How many of the scenario's goals were reached."),
    column("goals_total", _COUNT, "", "How many goals there were."),
    column("goal_times_s", _REALS, "s", "When each goal that was reached was reached, in their order."),
    column("path_length_m", _REAL, "m", "Length of the driven path."),
    column("shortest_path_m", _REAL, "m", _SHORTEST, nullable=True),
    column("spl", _REAL, "", _SPL, nullable=True),
    column("collisions", _COUNT, "", "Control steps in which a contact began."),
    column("impulse_ns", _REAL, "Ns", "What contacts pushed the robot with in the plane, summed up."),
    column("max_impulse_ns", _REAL, "Ns", "The most of it within one control step of 50 ms."),
    column("min_clearance_m", _REAL, "m", "Smallest distance from the robot's hull to a solid."),
    column("energy_j", _REAL, "J", "Integral of |actuator force x velocity| over time."),
    column("final_x_m", _REAL, "m", "Final position, x."),
    column("final_y_m", _REAL, "m", "Final position, y."),
    column("final_yaw_rad", _REAL, "rad", "Final heading, counter-clockwise from +x."),
    column("odometry_error_m", _REAL, "m", _ODOMETRY, nullable=True),
    column("metrics", _MEASURES, "", "What the scenario measures by itself, by name."),
]

ANSWERED = [
    column("status", _TEXT, "", "RoboMaker's job status: Completed, Failed or Canceled."),
    column("failure_code", _TEXT, "", "RoboMaker's failure code, or empty."),
    column("outcome", _TEXT, "", "Whether the robot did its task, as the scenario judges: Passed or Failed."),
    column("outcome_reason", _TEXT, "", "Why not: collision, timeout, stuck, out of bounds, crash; or empty."),
    column("success", _FLAG, "", "Completed and Passed: what the gate counts; null for Canceled.", nullable=True),
    column(
        "engine", _TEXT, "", "What drove the robot: planar, mjx or mujoco; empty if it did not start or was stopped."
    ),
    column("device", _TEXT, "", "The kind of device that it ran on, cpu or gpu; empty like engine."),
    column("recording", _TEXT, "", "File below recordings/<batch>/ that holds the episode's recording, or empty."),
]

EXPLAINED = [
    column("reason", _TEXT, "", "The failure code of a job that failed, else the outcome's reason; to group by."),
    column("failure_reason", _TEXT, "", "What happened, for a person, or empty."),
    column("trajectory_t_s", _REALS, "s", "Times of the downsampled trajectory."),
    column("trajectory_x_m", _REALS, "m", "Its positions, x."),
    column("trajectory_y_m", _REALS, "m", "Its positions, y."),
    column("trajectory_yaw_rad", _REALS, "rad", "Its headings, counter-clockwise from +x."),
]


def _metadata(table: str) -> dict[str, str]:
    return {"simyard.table": table, "simyard.schema_version": SCHEMA_VERSION}


RESULTS = pa.schema([*REQUESTED, *ANSWERED, *MEASURED], metadata=_metadata("results"))
FAILURES = pa.schema([*REQUESTED, *ANSWERED, *EXPLAINED, *MEASURED], metadata=_metadata("failures"))
