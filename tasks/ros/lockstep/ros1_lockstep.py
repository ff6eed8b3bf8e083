"""ROS 1 applications in lock-step with their episodes: a master, a robot, a network and processes for each lane."""

import functools
import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from specs.data.episode import PHYSICS_HZ
from specs.errors import LaunchRefused
from tasks.ros.graph.gazebo_services import MODEL_STATES, MODEL_STATES_KIND, GazeboServices, RobotState
from tasks.ros.graph.graph import Graph
from tasks.ros.graph.topic import Topic
from tasks.ros.launch.gazebo_launch import spawned_model, started_nodes
from tasks.ros.launch.launch_plan import (
    ImageLaunch,
    LaunchPlan,
    LaunchSource,
    episode_environment,
    joined_plan,
    make_ros_home,
    master_variables,
    node_environment,
    resolve_launch,
)
from tasks.ros.launch.message_modules import make_message_modules, named_packages
from tasks.ros.launch.packages import ros_installation
from tasks.ros.lockstep.exchange import (
    ExchangeTotals,
    FloorMap,
    GoalEnd,
    Launch,
    RobotBase,
    Sensed,
    TwistCommand,
)
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.robot_topics import ACTIONS, CLOCK, SensorMessages
from tasks.ros.lockstep.ros_lane import EventPump, RosLane, Writer
from tasks.ros.lockstep.sensor_topics import Moment
from tasks.ros.lockstep.step_driver import LockstepPatience, PollAudit, Readiness, StepDriver, told_gaps
from tasks.ros.message.navigation import MOVE_BASE
from tasks.ros.message.ros_messages import clock, stamp
from tasks.ros.process.application_processes import ApplicationProcesses, ProcessTracker, end_applications, end_strays
from tasks.ros.process.contention import ConnectionWatch, counts_bytes
from tasks.ros.process.lane_limits import NO_ROOM, LaneLimits
from tasks.ros.process.nap_gate import NapGate
from tasks.ros.process.network import EpisodeNetworks
from tasks.ros.process.rospy_waits import with_simulated_waits
from tasks.ros.process.thread_watch import allow_files, counts_runs
from tasks.storage.image_files import image_place

# Time 0 means "not known yet" to ROS 1.
BEGINS_NS = 1_000_000_000
_WARM_UP_STEPS = 10
# Statuses of a goal before the next one is sent.
_UNDER_WAY = frozenset({"asked", "accepted"})
_AGAIN_NS = 1_000_000_000
# What roscore sets: of two that look for it at once and find nothing, each sets its own, and one gives up.
_OF_CORE = {"/run_id": "00000000-0000-0000-0000-000000000000"}


class Ros1Lockstep:
    """The applications of all lanes of a chunk; see ``Lockstep``.

    Its thread must outlive it: the kernel ends nodes with the thread that started them.

    Args:
        launch: What is launched.
        base: The robot's base.
        control_s: Simulated time of a control step.
        clock_s: Simulated time between two ticks of ``/clock``; 0 for one tick a control step.
        patience: With an application.
        limits: Of each application.

    Attributes:
        placed: Where nodes set robots in the last control step, by lane.
    """

    def __init__(
        self,
        launch: Launch,
        base: RobotBase,
        control_s: float,
        *,
        clock_s: float = 0.0,
        patience: LockstepPatience | None = None,
        limits: LaneLimits | None = None,
    ) -> None:
        allow_files()
        self._launch, self._base = launch, base
        self._control_ns = round(control_s * 1e9)
        self._clock_ns = round(clock_s * 1e9) or self._control_ns
        self._limits = limits or LaneLimits()
        self._messages = SensorMessages(base, control_s)
        self._pump, self._networks = EventPump(), EpisodeNetworks(launch.home)
        self._tracker = ProcessTracker()
        self._patience = patience or LockstepPatience()
        self._driver = StepDriver(self._pump, self._patience, self._end)
        self._audit = PollAudit(self._pump)
        self._lanes: dict[int, RosLane] = {}
        self._failures: dict[int, str] = {}
        self._now_ns, self._step, self._closed = BEGINS_NS, 0, False
        self._due_ns, self._warm = math.inf, False
        self._modules: Path | None = None
        own = [each for each in (launch.source, launch.simulation) if each]
        images = {each: ImageLaunch.of(each, image_place(each.bundle)) for each in own}
        self._images = {each: image for each, image in images.items() if image}
        self._gazebo: dict[int, GazeboServices] = {}
        self.placed: dict[int, tuple[float, float, float]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def failures(self) -> Mapping[int, str]:
        """Returns why applications failed, by lane."""
        return {**self._failures, **{number: lane.failure for number, lane in self._lanes.items() if lane.failure}}

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose application called ``/robomaker/job/cancel``."""
        return frozenset(number for number, lane in self._lanes.items() if lane.graph.cancelled)

    @property
    def tests(self) -> Mapping[int, bool]:
        """Returns the lanes whose test nodes have ended, and whether all of them passed."""
        ended = {number: lane.application.tests_passed() for number, lane in self._lanes.items()}
        return {number: passed for number, passed in ended.items() if passed is not None}

    @property
    def goal_ends(self) -> Mapping[int, GoalEnd]:
        """Returns the lanes in which a goal ended otherwise than it should, and how."""
        found: dict[int, GoalEnd] = {}
        for number, lane in self._lanes.items():
            status, code = lane.graph.navigation.status, lane.graph.navigation.error_code
            if status == "canceled":
                found[number] = GoalEnd("canceled", code)
            elif status == "aborted" or (status == "rejected" and self._too_late(self._now_ns)):
                found[number] = GoalEnd("aborted", code)
        return found

    def heard(self, lane: int) -> list[tuple[str, bytes]]:  # noqa: ARG002 - as of ROS 2
        """Returns nothing: nodes of ROS 1 are recorded by rosbag."""
        return []

    def simulation_failed(self, lane: int) -> bool:
        """Returns whether what failed in a lane was the simulation application."""
        return self._launch.simulation == self._launch.source or (
            lane in self._lanes and self._lanes[lane].application.simulation_failed
        )

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorMap | None]) -> None:
        """Waits until every application is ready, and lets it warm up with its robot at rest.

        Raises:
            LaunchRefused: Nobody can tell here when an application is at rest.
            OSError: The machine has no room for so many.
        """
        if not counts_runs():
            raise LaunchRefused("this kernel does not tell how often threads are run (/proc/<pid>/schedstat)")
        driven = [number for number, own in enumerate(sensed) if own is not None]
        plans = self._plans(driven)
        for number, plan in zip(driven, plans, strict=True):
            if isinstance(plan, LaunchRefused):
                self._failures[number] = str(plan)
                continue
            own, lane = sensed[number], self._lane(number, plan)
            if lane.failure:
                self._end(lane)
            elif own is not None:
                self._publish_fixed(lane, own, floors[number])
        lanes = list(self._lanes.values())
        Readiness(self._pump, self._messages.commands.name, self._base.robot.ready_s, self._end).wait(lanes)
        for _ in range(_WARM_UP_STEPS):
            self.exchange(sensed)
        self._warm = True  # where a robot is set before is where the first step begins
        for lane in lanes:
            if not lane.failure:  # its totals say why it failed
                lane.command = TwistCommand()
                lane.commands = lane.late = lane.stray = lane.unordered = 0
        if self._launch.simulation is None:  # whoever judges may move the robot otherwise, or wait longer
            self._due_ns = self._now_ns + self._first_command_s * 1e9
        self._check_commanded(lanes)

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        """Returns each lane's command for the control step to come; None marks lanes that are done."""
        moving = {n: lane for n, lane in self._lanes.items() if sensed[n] is not None and not lane.failure}
        self._pump.turn()
        for number, lane in moving.items():
            lane.collect(self._now_ns, stray=True)
            gazebo, own = self._gazebo.get(number), sensed[number]
            lane.stray += gazebo.placements() if gazebo else 0
            if own is not None and not lane.failure:
                moment = Moment(self._step, self._now_ns, own, self._step - _WARM_UP_STEPS)
                lane.plan(self._planned(number, lane, moment))
        lanes = [lane for lane in moving.values() if not lane.failure]
        self._driver.run(lanes, self._now_ns)
        self._audit.run(lanes, self._step)
        self._check(moving)
        self._stop_idle(lanes)
        for gazebo in self._gazebo.values():
            gazebo.placements()
        found = ((n, gazebo.take_pose()) for n, gazebo in self._gazebo.items() if n in moving and self._warm)
        self.placed = {n: pose for n, pose in found if pose is not None}
        self._now_ns, self._step = self._now_ns + self._control_ns, self._step + 1
        self._check_commanded(lanes)
        return [self._lanes[n].command if n in moving else TwistCommand() for n in range(len(sensed))]

    def tally(self, lane: int) -> ExchangeTotals:
        """Returns how the exchange of a lane went so far."""
        return self._lanes[lane].tally() if lane in self._lanes else ExchangeTotals()

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns what a lane's application gave to ``/robomaker/job/add_tags``."""
        return dict(self._lanes[lane].graph.tags) if lane in self._lanes else {}

    def printed(self, lane: int) -> str:
        """Returns what a lane's nodes printed last, and what they said or waited for in vain."""
        if lane not in self._lanes:
            return ""
        found = self._lanes[lane]
        return "\n".join([found.application.printed(), *found.graph.gaps(), *found.application.gate.gaps()]).strip()

    def processes(self, lane: int) -> list[int]:
        """Returns the processes of a lane's application, as of the last control step."""
        return self._lanes[lane].application.processes() if lane in self._lanes else []

    def close(self) -> None:
        """Ends every process, closes every port, removes every file; nothing happens a second time."""
        if self._closed:
            return
        self._closed = True
        end_applications([lane.application for lane in self._lanes.values()], self._tracker)
        end_strays(self._tracker)
        for lane in self._lanes.values():
            lane.graph.close()
            lane.network.close()
        self._networks.close()
        self._tracker.close()
        self._pump.close()
        shutil.rmtree(self._launch.home, ignore_errors=True)

    def _plans(self, driven: Sequence[int]) -> list[LaunchPlan | LaunchRefused]:
        """Returns what is started in each of some lanes, or why nothing can be."""
        source, simulation = self._launch.source, self._launch.simulation
        own, judging = ([self._launch.variables(lane, simulation=each) for lane in driven] for each in (False, True))
        robots = self._resolved(source, own) if source != simulation else [None] * len(driven)
        if simulation is None:
            return [each for each in robots if each is not None]
        both = zip(robots, self._resolved(simulation, judging), strict=True)
        joined = [_joined(robot, judge) for robot, judge in both]
        bundles = dict.fromkeys((source.bundle, simulation.bundle))
        return [
            plan._replace(model=spawned_model(plan, bundles, variables)) if isinstance(plan, LaunchPlan) else plan
            for plan, variables in zip(joined, judging, strict=True)
        ]

    def _resolved(
        self, source: LaunchSource, environments: list[Mapping[str, str]]
    ) -> Sequence[LaunchPlan | LaunchRefused]:
        """Returns what one application starts with each environment, or why nothing."""
        if image := self._images.get(source):
            return [image.plan(simulation=source == self._launch.simulation) for _ in environments]
        if self._modules is None:
            bundles = dict.fromkeys(each.bundle for each in (self._launch.source, self._launch.simulation) if each)
            packages = [name for bundle in bundles for name in named_packages(bundle)]
            self._modules = make_message_modules(self._launch.home / "messages", ros_installation(), packages)
        return resolve_launch(source, environments)

    def _lane(self, number: int, plan: LaunchPlan) -> RosLane:
        """Returns a lane with its nodes started, or with why they cannot be.

        Raises:
            LaunchRefused: Nobody can tell here whether its nodes race.
        """
        if not counts_bytes():
            raise LaunchRefused(
                "this kernel does not tell of connections (sock_diag(7)), by which races of nodes are seen"
            )
        installation, network, topics = ros_installation(), self._networks.new(), self._messages.topics
        gazebo = self._launch.simulation and GazeboServices(plan.model, 1 / PHYSICS_HZ)
        if gazebo is not None:
            topics, self._gazebo[number] = (*topics, Topic(MODEL_STATES, MODEL_STATES_KIND)), gazebo
        home = make_ros_home(self._launch.home / f"lane-{number}", installation)
        try:
            commands, acts = [self._messages.commands], self._base.robot.goals == "move_base"
            graph = Graph(self._pump.loop, topics, commands, network.new_socket, gazebo, navigates=acts)
        except OSError:
            network.close()
            raise
        latched = frozenset(topic.name for topic in self._messages.topics if topic.latched)
        application = ApplicationProcesses(home, self._tracker, self._limits, NapGate(self._pump.loop))
        detector = IdleDetector(application, graph, self._patience.nap_s)
        contended = ConnectionWatch(application, network, graph.take_asked).contended
        lane = self._lanes[number] = RosLane(detector, network, self._pump, latched, contended)
        try:
            of_core = _OF_CORE if self._images else {}
            for name, value in {**plan.parameters, "/use_sim_time": True, **of_core}.items():
                graph.set_parameter(name, value)
        except ValueError as exc:
            lane.failure = f"a parameter of its launch file: {exc}"
            return lane
        for source, own in self._divided(plan):
            variables = self._launch.variables(number, simulation=source == self._launch.simulation)
            if image := self._images.get(source):
                self._enter(lane, image, own, {**variables, **master_variables(graph.uri)}, network.prefix)
                continue
            environment = node_environment(installation, source.bundle, graph.uri, home, variables)
            modules = ":".join(filter(None, (environment["PYTHONPATH"], str(self._modules or ""))))
            environment["PYTHONPATH"] = with_simulated_waits(home, modules)
            self._start(lane, own, environment, network.prefix)
        return lane

    def _divided(self, plan: LaunchPlan) -> list[tuple[LaunchSource, LaunchPlan]]:
        """Returns what of a plan is the robot application's, and then what is the simulation application's."""
        found = [(self._launch.source, False), (self._launch.simulation or self._launch.source, True)]
        parts = [(source, tuple(node for node in plan.nodes if node.simulation is ours)) for source, ours in found]
        return [(source, plan._replace(nodes=nodes)) for source, nodes in parts if nodes]

    def _enter(
        self,
        lane: RosLane,
        image: ImageLaunch,
        plan: LaunchPlan,
        variables: Mapping[str, str],
        prefix: Sequence[str] = (),
    ) -> None:
        """Starts what a container image runs in a lane; notes why if it cannot be."""
        home, name = lane.application.home, "PYTHONPATH"
        waits = {name: with_simulated_waits(home, {**image.image.environment, **variables}.get(name, ""))}
        try:
            self._start(lane, *image.entered(plan, {**variables, **episode_environment(home), **waits}, home), prefix)
        except LaunchRefused as exc:
            lane.failure = str(exc)

    def _start(
        self, lane: RosLane, plan: LaunchPlan, environment: Mapping[str, str], prefix: Sequence[str] = ()
    ) -> None:
        """Starts a lane's nodes; notes why if one cannot be.

        Raises:
            OSError: The machine has no room for so many.
        """
        try:
            lane.application.start(started_nodes(plan), environment, prefix)
        except (OSError, ValueError) as exc:
            if isinstance(exc, OSError) and exc.errno in NO_ROOM:
                raise
            lane.failure = f"a node cannot be started: {exc}"

    def _publish_fixed(self, lane: RosLane, sensed: Sensed, floor: FloorMap | None) -> None:
        moment = Moment(0, self._now_ns, sensed)
        lane.graph.publish(CLOCK, self._messages.write(CLOCK, moment))
        for topic, data in self._messages.fixed(moment, floor).items():
            lane.graph.publish(topic, data)

    def _planned(self, number: int, lane: RosLane, moment: Moment) -> list[tuple[str, Writer]]:
        """Returns what a lane is sent in a control step: ticks, a goal that is new, then all its sensors."""
        planned: list[tuple[str, Writer]] = []
        if self._now_ns > BEGINS_NS:
            ticks = range(self._now_ns - self._control_ns + self._clock_ns, self._now_ns, self._clock_ns)
            planned += [(CLOCK, functools.partial(clock, stamp(tick_ns))) for tick_ns in ticks]
        due = self._messages.due(moment)
        planned += [(topic, functools.partial(self._messages.write, topic, moment)) for topic in due]
        if gazebo := self._gazebo.get(number):
            x, y, yaw = map(float, moment.sensed.pose)
            ahead, left, turn = map(float, moment.sensed.velocity)
            gazebo.tell(RobotState(moment.time_ns, (x, y, yaw), (ahead, left, turn)))
            planned.append((MODEL_STATES, gazebo.model_states))
        x, y = map(float, moment.sensed.goal)
        found = self._messages.goal(moment) if self._goal_due(lane, moment) else None
        if found is not None:
            (topic, data), lane.goal, lane.asked_ns = found, (x, y), moment.time_ns
            data = lane.graph.navigation.ask(data) if topic == MOVE_BASE else data
            planned.insert(len(planned) - len(due) - bool(gazebo) + 1, (topic, lambda: data))
        return planned

    def _goal_due(self, lane: RosLane, moment: Moment) -> bool:
        """Returns whether a lane is to be told its goal: one that is new.

        As an action it is sent when the one before has ended, to who is there, and again if it was rejected: Nav2
        rejects goals until all of it is active.
        """
        status = lane.graph.navigation.status
        if status == "rejected" and moment.time_ns - lane.asked_ns >= _AGAIN_NS and not self._too_late(moment.time_ns):
            lane.goal = None
        x, y = map(float, moment.sensed.goal)
        action = ACTIONS.get(self._base.robot.goals)
        if lane.goal == (x, y) or not action:
            return lane.goal != (x, y)
        return status not in _UNDER_WAY and bool(lane.graph.outgoing[action])

    def _too_late(self, now_ns: int) -> bool:
        """Returns whether a goal that is rejected is not sent again."""
        return now_ns > BEGINS_NS + self._base.robot.first_command_s * 1e9

    def _check(self, moving: Mapping[int, RosLane]) -> None:
        """Fails lanes whose nodes ended, and of one lane a step looks how much it uses."""
        for number, lane in moving.items():
            lane.check()
            if not lane.failure and self._step % len(self._launch.environment) == number:
                lane.failure = lane.application.excess()
            if lane.failure:
                self._end(lane)

    @property
    def _first_command_s(self) -> float:
        return self._base.robot.first_command_s

    def _check_commanded(self, lanes: Sequence[RosLane]) -> None:
        """Fails lanes in which no node publishes commands, though it is time."""
        topic, acts = self._messages.commands.name, self._base.robot.goals == "move_base"
        for lane in lanes if self._now_ns >= self._due_ns else ():
            idle = acts and lane.graph.navigation.status == "none"
            if lane.failure or (lane.graph.publishers(topic) and not idle):
                continue
            what = "offers the action /move_base (goals in ros.yaml)" if idle else f"publishes {topic}"
            within = f" within {self._first_command_s:g} simulated s (first_command_s in ros.yaml)"
            lane.failure = f"no node {what}{within if self._first_command_s else ''}{told_gaps(lane)}"
            self._end(lane)

    def _stop_idle(self, lanes: Sequence[RosLane]) -> None:
        hold_ns = round(self._base.robot.command_timeout_s * 1e9)
        for lane in lanes:
            if hold_ns and self._now_ns - lane.commanded_ns > hold_ns:
                lane.command = TwistCommand()

    def _end(self, lane: RosLane) -> None:
        """Ends what belongs to a lane that failed; its neighbours need the machine."""
        lane.command = TwistCommand()
        end_applications([lane.application], self._tracker)
        lane.graph.close()
        lane.network.close()


def _joined(
    robot: LaunchPlan | LaunchRefused | None, simulation: LaunchPlan | LaunchRefused
) -> LaunchPlan | LaunchRefused:
    """Returns what the applications of an episode start together, or why one of them cannot."""
    for each in (simulation, robot):
        if isinstance(each, LaunchRefused):
            return each
    return joined_plan(robot, simulation)  # pyright: ignore[reportArgumentType] - neither is refused
