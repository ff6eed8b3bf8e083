"""Drives lanes through a control step, each as fast as its own application comes to rest.

Before the first step it waits until an application is ready; in an episode it looks whether nodes have begun to poll.
"""

import logging
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from tasks.ros.lockstep.idle_detector import IdleState
from tasks.ros.lockstep.robot_topics import CLOCK
from tasks.ros.lockstep.ros_lane import EventPump, RosLane
from tasks.ros.process.thread_watch import own_wait_s

_LOG = logging.getLogger(__name__)
_SOON_S = 0.00003
_FIRST_NAP_S = 0.0001
_NAP_GROWTH = 1.5
_LONGEST_NAP_S = 0.001
_CHECK_S = 0.25


class LockstepPatience(NamedTuple):
    """How long an application may take.

    Attributes:
        stage_s: Until it comes to rest after a message; see ``IdleDetector.has_time``.
        nap_s: As long as a callback may sleep by the wall's clock; less than a stage may take.
        late_limit: How often it may come to rest too late; then it has failed.
    """

    stage_s: float = 2.0
    nap_s: float = 1.0
    late_limit: int = 5


class StepDriver:
    """Brings lanes through a control step; none waits for another one before all have come to its end.

    Args:
        pump: Serves their graphs.
        patience: With an application.
        fail: Called with a lane that failed, to end its application at once.
    """

    def __init__(self, pump: EventPump, patience: LockstepPatience, fail: Callable[[RosLane], None]) -> None:
        self._pump, self._patience, self._fail = pump, patience, fail
        self._checked_s = 0.0

    def run(self, lanes: Sequence[RosLane], time_ns: int) -> None:
        """Sends what is planned, and returns when all of these lanes are at rest, or have failed."""
        now_s = time.perf_counter()
        active = [lane for lane in lanes if not lane.failure and lane.send(now_s, fresh=False)]
        while active:
            self._pump.serve()
            now_s = time.perf_counter()
            due = [lane for lane in active if lane.look_s <= now_s]
            over = [lane for lane in due if not self._advance(lane, time_ns)]
            if over:
                active = [lane for lane in active if lane not in over]
                continue
            self._check(active, now_s)
            wait_s = min(lane.look_s for lane in active) - time.perf_counter()
            if wait_s > 0.0 and self._pump.nap(wait_s):
                for lane in active:
                    lane.collect(time_ns)

    def _advance(self, lane: RosLane, time_ns: int) -> bool:
        """Looks at a lane, and sends it the next message if it is quiet; returns False if it is through."""
        now_s = time.perf_counter()
        if lane.failure:
            self._fail(lane)
            return False
        verdict = lane.detector.look(now_s)
        if verdict is IdleState.QUIET:
            lane.note_rest()
        elif verdict is IdleState.STOPPED:
            lane.failure = lane.application.stopped()
        elif lane.detector.has_time(self._patience.stage_s, now_s):
            self._postpone(lane, verdict, now_s)
            return True
        else:
            lane.late += 1
            limit_s, restless = self._patience.stage_s, lane.detector.restless(now_s)
            late = f"the application did not come to rest within {limit_s:g} s, {lane.late} times"
            _LOG.warning("%s, %.1f s after %s was sent: %s", late, now_s - lane.begun_s, lane.topic, restless)
            if lane.application.watch.stopped():  # a stopped node acknowledges nothing, so it never seems at rest
                lane.failure = lane.application.stopped()
            elif lane.late >= self._patience.late_limit:
                lane.failure = ": ".join(filter(None, (late, restless)))
        lane.collect(time_ns)
        if lane.failure:
            self._fail(lane)
            return False
        return lane.send(now_s, fresh=True)

    def _postpone(self, lane: RosLane, verdict: IdleState, now_s: float) -> None:
        if verdict is IdleState.SOON:
            lane.look_s = now_s + _SOON_S
        elif verdict is IdleState.WAITS:
            lane.look_s = max(lane.detector.next_s, now_s + _SOON_S)
        else:
            lane.nap_s = min(max(_FIRST_NAP_S, _NAP_GROWTH * lane.nap_s), _LONGEST_NAP_S)
            lane.look_s = now_s + lane.nap_s

    def _check(self, active: Sequence[RosLane], now_s: float) -> None:
        """Looks now and then, while lanes take long, what they use: one that uses too much is ended next."""
        if now_s - self._checked_s < _CHECK_S:
            return
        self._checked_s = now_s
        for lane in active:
            if now_s - lane.begun_s > _CHECK_S:
                lane.notice_ends()  # it would wait for an answer of who is gone
                lane.failure = lane.failure or lane.application.excess()
                lane.look_s = now_s


_IDLE_S = 0.25
# A node that sleeps within its start-up has not published its commands yet; a relay does so with the first message.
_IDLE_WITHOUT_COMMANDS_S = 1.5
# Where others have the cores, a start takes longer: as long as whoever looks waited for one, up to so many limits.
_MOST_WAITED = 4.0
_ROUND_S = 0.02
_PAUSE_S = 0.0005
_GAPS_TOLD = 5


def _serve_for(pump: EventPump, seconds: float) -> None:
    """Answers requests for some time; commands end a nap of the pump at once, and are not read here."""
    ends_s = time.perf_counter() + seconds
    while (left_s := ends_s - time.perf_counter()) > 0.0:
        pump.nap(left_s)
        pump.serve()
        time.sleep(_PAUSE_S)


def told_gaps(lane: RosLane) -> str:
    """Returns what a lane's nodes say or wait for in vain, as the end of a reason; empty if there is nothing."""
    return "".join(f"; {each}" for each in lane.graph.gaps()[:_GAPS_TOLD])


class Readiness:
    """Waits for lanes.

    Args:
        pump: Serves their graphs.
        commands: Name of the topic that drives the robot.
        limit_s: How long they may take, without what whoever looks waited for a core.
        fail: Called with a lane that failed.
    """

    def __init__(self, pump: EventPump, commands: str, limit_s: float, fail: Callable[[RosLane], None]) -> None:
        self._pump, self._commands, self._limit_s, self._fail = pump, commands, limit_s, fail
        self._changes: dict[int, int] = {}
        self._since_s: dict[int, float] = {}
        self._ends_s = self._waited_s = 0.0

    def wait(self, lanes: Sequence[RosLane]) -> None:
        """Returns when each lane is ready, or has failed with a reason."""
        waiting = [lane for lane in lanes if not lane.failure]
        self._ends_s, self._waited_s = time.perf_counter() + self._limit_s, own_wait_s()
        while waiting:
            self._pump.turn()
            self._pump.serve()
            for lane in list(waiting):
                lane.drain()
                lane.check()
                if lane.failure or self._ready(lane):
                    waiting.remove(lane)
                elif self._over():
                    why = self._missing(lane) or self._unrest(lane)
                    lane.failure = f"not ready within {self._limit_s:g} s: {why}{self._untaken(lane)}"
                    waiting.remove(lane)
                if lane.failure:
                    self._fail(lane)
            _serve_for(self._pump, _ROUND_S)

    def _over(self) -> bool:
        """Returns whether lanes had their time."""
        more_s = time.perf_counter() - self._ends_s
        return more_s > 0.0 and more_s > min(own_wait_s() - self._waited_s, _MOST_WAITED * self._limit_s)

    def _ready(self, lane: RosLane) -> bool:
        """Returns whether a lane has been complete and at rest for a while."""
        key, now_s = id(lane), time.perf_counter()
        if self._changes.get(key) != lane.graph.changes or self._missing(lane):
            self._changes[key] = lane.graph.changes
            self._since_s.pop(key, None)
            return False
        if not self._rests(lane):
            self._since_s.pop(key, None)
            return False
        if key not in self._since_s:
            self._since_s[key] = now_s
            lane.detector.count(now_s)
            return False
        commanded, idle_s = lane.graph.publishers(self._commands), now_s - self._since_s[key]
        if idle_s < (_IDLE_S if commanded else _IDLE_WITHOUT_COMMANDS_S):
            return False
        # One that sleeps by the wall's clock may advertise when it wakes: in an episode, at another moment each time.
        if not commanded and not self._over() and lane.detector.sleeps_on():
            return False
        lane.detector.find_pollers(now_s)
        lane.detector.find_sleepers()
        return True

    def _rests(self, lane: RosLane) -> bool:
        """Returns whether a lane sleeps: one look in three will do, for a process that polls is awake now and then."""
        for _ in range(3):
            if lane.detector.look(time.perf_counter()) is not IdleState.AWAKE:
                return True
            time.sleep(_PAUSE_S)
            self._pump.serve()
        return False

    def _missing(self, lane: RosLane) -> str:
        """Returns what a lane lacks, for a person; empty if it is complete."""
        unknown = sorted(lane.application.names - lane.graph.nodes())
        if unknown:
            return f"{', '.join(unknown)} did not register with the master"
        if lane.application.anonymous and not lane.graph.nodes():
            return "no node of the container image registered with the master"
        unconnected = lane.graph.unconnected()
        if unconnected:
            return "; ".join(unconnected)
        return self._unrest(lane) if lane.graph.busy else ""

    def _unrest(self, lane: RosLane) -> str:
        """Returns why a lane that is complete does not begin: one that sleeps before it advertises is waited for."""
        quiet = "" if lane.graph.publishers(self._commands) else f", and none of them publishes {self._commands}"
        by_wall = "" if lane.graph.outgoing.get(CLOCK) else f", and none reads {CLOCK}: use_sim_time: true is for that"
        # Nothing is sent to them yet, so what they go on to say has no other cause.
        if lane.commands > self._limit_s:
            by_wall += f", and they publish {self._commands} by the wall's clock: {lane.commands} commands"
        return f"its nodes did not come to rest{quiet}{by_wall}"

    def _untaken(self, lane: RosLane) -> str:
        """Returns what nodes say or wait for in vain, where none of them drives the robot."""
        return "" if lane.graph.publishers(self._commands) else told_gaps(lane)


_FIRST_STEP = 5
_WATCHED_S = 0.05


class PollAudit:
    """Watches lanes at rest for a moment, at control step 5, and when one of them is suspected.

    From one time to the next the number of steps doubles at least: a node that makes threads all the time may not cost
    more than that.

    Args:
        pump: Serves their graphs.
    """

    def __init__(self, pump: EventPump) -> None:
        self._pump, self._next = pump, _FIRST_STEP

    def run(self, lanes: Sequence[RosLane], step: int) -> None:
        """Finds threads that wake up by themselves, if it is time for that."""
        suspect = step == _FIRST_STEP or any(lane.detector.suspect for lane in lanes)
        if step < self._next or not suspect:
            return
        self._next = 2 * step
        begun_s = time.perf_counter()
        lanes = [lane for lane in lanes if not lane.failure]
        for lane in lanes:
            lane.detector.count(begun_s)
        _serve_for(self._pump, _WATCHED_S)
        for lane in lanes:
            lane.detector.find_pollers(time.perf_counter())
