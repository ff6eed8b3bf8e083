"""One episode (one simulation job): what is asked for, and what came of it."""

import shlex
from typing import Literal, NamedTuple

from pydantic import Field

from specs.base import Spec
from specs.data.boxes import Box
from specs.data.outcomes import OutcomeReason
from specs.data.people import People
from specs.data.robots import own_seed
from specs.field_types import Architecture
from specs.launched_file import module_name, names_ros_launch
from specs.robomaker.simulation import FailureBehavior, SimulationJobErrorCode

# How often sensors are read and controls decided, and how often physics is stepped between them unless a robot.xml asks
# for other steps.
CONTROL_HZ, PHYSICS_HZ = 20, 200
CONTROL_S = 1 / CONTROL_HZ
_NEVER = 1 << 30  # control steps: a program counts them in 32 bits


def control_stride(rate_hz: float, control_s: float = CONTROL_S) -> int:
    """Returns how many control steps lie between two readings of a sensor: at most so many that an episode has but one.

    Args:
        rate_hz: Readings in a simulated second, made a whole fraction of control steps; 0 for one each.
        control_s: Simulated time of a control step.
    """
    return max(1, round(min(1.0 / control_s / rate_hz, _NEVER))) if rate_hz > 0.0 else 1


CANCELED = "Canceled"
# Why a job is Canceled whose own application called /robomaker/job/cancel.
WITHDRAWN = "its own application asked for the end of its job"
Outcome = Literal["Passed", "Failed"]
FailureCode = SimulationJobErrorCode | Literal[""]


class Failure(NamedTuple):
    """Why an episode cannot be simulated.

    Attributes:
        code: RoboMaker's failure code.
        reason: What happened, for a person.
    """

    code: SimulationJobErrorCode
    reason: str

    def __str__(self) -> str:
        """Returns both in one line."""
        return f"{self.code}: {self.reason}"


class ApplicationLaunch(Spec):
    """An application as a batch uses it.

    Attributes:
        name: The application's name.
        version: The version asked for: a number, or ``$LATEST``.
        digest: SHA-256 of the bundle, lower-case hex.
        package: The launch configuration's packageName.
        launch_file: The launch configuration's launchFile, without ``.py`` if it is a Python module.
        architecture: Which of the version's builds that bundle is; None where one is for all of them.
        command: Of a container image: the launch configuration's command.
    """

    name: str
    version: str
    digest: str
    package: str
    launch_file: str
    architecture: Architecture | None = None
    command: tuple[str, ...] | None = None

    @property
    def launched(self) -> str:
        """Returns what tells it from another launch of its bundle: the launch file, or a container image's command."""
        return self.launch_file or shlex.join(self.command or ())

    @property
    def module(self) -> str:
        """Returns the name of the Python module that is meant, if one is."""
        return module_name(self.launch_file)

    @property
    def starts_nodes(self) -> bool:
        """Returns whether nodes run: of a launch file of ROS, or of a container image's command.

        A module's ending is gone when a batch is planned.
        """
        return names_ros_launch(self.launch_file) or self.command is not None


def is_alone(robot: ApplicationLaunch, scenario: ApplicationLaunch) -> bool:
    """Returns whether a simulation application runs without a robot application: its own nodes drive the robot."""
    return scenario.starts_nodes and robot == scenario


class EpisodeRequest(Spec):
    """One lane of a batch.

    Attributes:
        index: Position in the batch, from 0; the job is ``<batch>/<index>``.
        world: ``<generation>/<world>``.
        seed: Draws the scenario's goals and the sensors' noise.
        robot: What drives; the simulation application itself, where there is no robot application.
        scenario: What judges.
        environment: Environment variables as the launch configurations and the matrix give them.
        judge_environment: Those that the simulation application's own nodes have otherwise; None for none.
        people: Who walks in its world; None for nobody.
        boxes: What is put into its world while the robot drives; None for nothing.
        robots: How many robots share its world, each with a request and a row of its own; None for this one alone.
        number: Which of them this one is, from 0.
        duration_s: Simulated seconds at most (maxJobDurationInSeconds).
    """

    index: int
    world: str
    seed: int
    robot: ApplicationLaunch
    scenario: ApplicationLaunch
    environment: dict[str, str]
    duration_s: float
    failure_behavior: FailureBehavior = "Fail"
    judge_environment: dict[str, str] | None = None
    people: People | None = None
    boxes: tuple[Box, ...] | None = None
    robots: int | None = None
    number: int = 0

    @property
    def sharing(self) -> int:
        """Returns how many robots drive in its world together; 1 is it alone."""
        return self.robots or 1

    @property
    def own_seed(self) -> int:
        """Returns the seed of what is drawn of this robot alone."""
        return own_seed(self.seed, self.number)

    @property
    def judge_variables(self) -> dict[str, str]:
        """Returns the environment variables of the simulation application's nodes."""
        return {**self.environment, **(self.judge_environment or {})}

    @property
    def told_variables(self) -> dict[str, str]:
        """Returns all environment variables; ``simulation:NAME`` is what the judge has otherwise."""
        return {**self.environment, **{f"simulation:{name}": it for name, it in (self.judge_environment or {}).items()}}

    @property
    def alone(self) -> bool:
        """Returns whether there is no robot application."""
        return is_alone(self.robot, self.scenario)

    @property
    def bundles(self) -> frozenset[str]:
        """The digests of the bundles that it runs: no other application is in the process that simulates it."""
        return frozenset({self.robot.digest, self.scenario.digest})


class EpisodeResult(Spec):
    """What came of one lane: a rerun of the request on the same kind of device gives the same row.

    Attributes:
        status: RoboMaker's job status.
        failure_code: RoboMaker's failure code, or empty.
        failure_reason: What happened, for a person, or empty.
        outcome: Whether the robot did its task, as the scenario judges.
        outcome_reason: Why not, or empty.
        simulated_s: Simulated time until the episode ended.
        goals_reached: How many of the scenario's goals were reached.
        goals_total: How many there were.
        path_length_m: Length of the driven path.
        goal_times_s: When each goal that was reached was reached, in order.
        shortest_path_m: Length of the shortest way from the start to where each goal counts as reached, in order, for a
            disc of the hull's radius; None where there is none, or where goals are no destinations.
        spl: Success weighted by path length, 0-1 (Anderson et al. 2018, arXiv:1807.06757); None without a shortest way.
        collisions: Control steps in which a contact began.
        impulse_ns: What contacts pushed the robot with, summed up.
        max_impulse_ns: The most of it within a control step.
        min_clearance_m: Smallest distance, seen from above, from the robot's hull to a solid at its heights.
        energy_j: Integral of |actuator force x velocity|.
        final_x_m: Final pose.
        odometry_error_m: How far the robot's believed place was from its final one; None for one without odometry.
        late: Stages of control steps at which a ROS application did not come to rest in time, or two of its processes
            told a third one something; and datagrams to nodes of ROS 2 or their robot that were dropped; None for other
            robots.
        stray: Commands and places that a ROS application gave its robot after it was taken for quiet; None likewise.
        person_contacts: Control steps in which a contact with a person began; None in an episode without people, as the
            all whose names say person.
        person_standing_contacts: Those that began while the robot stood still.
        person_contact_m_s: The highest speed of robot and person against each other at which one began; 0 without any.
        person_energy_j: The most that a contact, of a robot that moved, put into a body region (ISO/TS 15066, annex A).
        person_force_n: The highest force on one.
        person_force_margin: 1 less the highest share of its limit that such a force came to.
        min_person_m: Smallest distance, seen from above, from the robot's hull to a person.
        min_person_collision_s: Smallest time to a collision with one, at most 60.
        person_personal_s: Simulated time within 1.2 m of a person (Hall 1966).
        person_intimate_s: Simulated time within 0.45 m of one.
        person_frozen_s: The longest time in which it stood still within 1.2 m of one.
        robot_contacts: Control steps in which a contact with another robot began; None where it is alone, as the two
            that follow.
        robot_contact_m_s: The highest speed of both against each other at which one began; 0 without any.
        min_robot_m: Smallest distance, seen from above, from the circle around the hull to another robot's.
        metrics: What the scenario measures by itself, by name.
        rooms_entered: Names of the rooms that the robot's position was in, in the order in which it came to them.
        rooms_unreachable: Names of the rooms that a disc of the hull's radius cannot get to from the start, with doors
            as they stand.
        rooms_total: How many rooms the world has; 0 if the episode did not start.
        goals_reachable: How many of the goals such a disc can get to; None where goals are no destinations.
        trajectory: Downsampled poses (t_s, x_m, y_m, yaw_rad), kept for failed episodes, else empty.
        recording: Name of the file with the episode's recording, beside others of the batch, or empty.
        engine: The engine that drove it, or empty if it did not start or was stopped.
        device: The kind of device that drove it, ``cpu`` or ``gpu``, or empty likewise.
    """

    index: int
    status: Literal["Completed", "Failed", "Canceled"]
    failure_code: FailureCode
    failure_reason: str
    outcome: Outcome
    outcome_reason: OutcomeReason
    simulated_s: float
    goals_reached: int
    goals_total: int
    path_length_m: float
    goal_times_s: tuple[float, ...] = ()
    shortest_path_m: float | None
    spl: float | None
    collisions: int
    impulse_ns: float = 0.0
    max_impulse_ns: float = 0.0
    min_clearance_m: float
    energy_j: float
    final_x_m: float
    final_y_m: float
    final_yaw_rad: float
    odometry_error_m: float | None = None
    late: int | None = None
    stray: int | None = None
    person_contacts: int | None = None
    person_standing_contacts: int | None = None
    person_contact_m_s: float | None = None
    person_energy_j: float | None = None
    person_force_n: float | None = None
    person_force_margin: float | None = None
    min_person_m: float | None = None
    min_person_collision_s: float | None = None
    person_personal_s: float | None = None
    person_intimate_s: float | None = None
    person_frozen_s: float | None = None
    robot_contacts: int | None = None
    robot_contact_m_s: float | None = None
    min_robot_m: float | None = None
    metrics: dict[str, float] = Field(default_factory=dict[str, float])
    rooms_entered: tuple[str, ...] = ()
    rooms_unreachable: tuple[str, ...] = ()
    rooms_total: int = 0
    goals_reachable: int | None = None
    trajectory: tuple[tuple[float, float, float, float], ...]
    recording: str = ""
    engine: str = ""
    device: str = ""


def unfinished_result(
    index: int,
    status: Literal["Failed", "Canceled"],
    *,
    failure_code: FailureCode,
    failure_reason: str,
    outcome_reason: OutcomeReason = "",
) -> EpisodeResult:
    """Returns the result of an episode that has nothing to measure: it never started, or was stopped.

    Args:
        index: The episode's.
        status: Failed if it could not start, Canceled if it was stopped.
        failure_code: RoboMaker's failure code, or empty.
        failure_reason: What happened, for a person, or empty.
        outcome_reason: Why the robot did not do its task, or empty.
    """
    return EpisodeResult(
        index=index,
        status=status,
        failure_code=failure_code,
        failure_reason=failure_reason,
        outcome="Failed",
        outcome_reason=outcome_reason,
        simulated_s=0.0,
        goals_reached=0,
        goals_total=0,
        path_length_m=0.0,
        shortest_path_m=0.0,
        spl=0.0,
        collisions=0,
        min_clearance_m=0.0,
        energy_j=0.0,
        final_x_m=0.0,
        final_y_m=0.0,
        final_yaw_rad=0.0,
        trajectory=(),
    )


def success(result: EpisodeResult) -> bool | None:
    """Returns whether the episode counts as passed; None for one that was canceled, which counts as nothing.

    A job that RoboMaker would call Failed did not pass, whatever the scenario saw before.
    """
    if result.status == CANCELED:
        return None
    return result.status == "Completed" and result.outcome == "Passed"


def reason(result: EpisodeResult) -> str:
    """Returns why an episode did not pass, in one or two words to group by; empty for one that passed."""
    if success(result):
        return ""
    return short_reason(result.failure_code, result.outcome_reason, result.status)


def short_reason(failure_code: str, outcome_reason: str, status: str) -> str:
    """Returns why an episode that did not pass did not: the failure code of a job that failed comes first."""
    return failure_code or outcome_reason or status


def failed_result(index: int, failure: Failure) -> EpisodeResult:
    """Returns the result of an episode that could not start."""
    return unfinished_result(
        index, "Failed", failure_code=failure.code, failure_reason=failure.reason, outcome_reason="crash"
    )
