"""When an application is ready: its nodes are known, connected and at rest."""

import time
from collections.abc import Callable, Sequence

from tasks.ros.lockstep.event_pump import EventPump
from tasks.ros.lockstep.quiet import Verdict
from tasks.ros.lockstep.ros_lane import RosLane

_IDLE_S = 0.25
# A node that sleeps within its start-up has not published its commands yet; a relay does so with the first message.
_IDLE_WITHOUT_COMMANDS_S = 1.5
_ROUND_S = 0.02
_PAUSE_S = 0.0005


class Readiness:
    """Waits for lanes.

    Args:
        pump: Serves their graphs.
        commands: Name of the topic that drives the robot.
        limit_s: How long they may take.
        fail: Called with a lane that failed.
    """

    def __init__(self, pump: EventPump, commands: str, limit_s: float, fail: Callable[[RosLane], None]) -> None:
        self._pump, self._commands, self._limit_s, self._fail = pump, commands, limit_s, fail
        self._changes: dict[int, int] = {}
        self._since_s: dict[int, float] = {}

    def wait(self, lanes: Sequence[RosLane]) -> None:
        """Returns when each lane is ready, or has failed with a reason."""
        begun_s, waiting = time.perf_counter(), [lane for lane in lanes if not lane.failure]
        while waiting:
            self._pump.turn()
            self._pump.serve()
            for lane in list(waiting):
                lane.drain()
                lane.check()
                if lane.failure or self._ready(lane):
                    waiting.remove(lane)
                elif time.perf_counter() - begun_s > self._limit_s:
                    lane.failure = f"not ready within {self._limit_s:g} s: {self._missing(lane)}"
                    waiting.remove(lane)
                if lane.failure:
                    self._fail(lane)
            self._rest()

    def _rest(self) -> None:
        ends_s = time.perf_counter() + _ROUND_S
        while (left_s := ends_s - time.perf_counter()) > 0.0:
            self._pump.nap(left_s)
            self._pump.serve()
            # Commands end a nap at once, and are not read here.
            time.sleep(_PAUSE_S)

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
            lane.judge.count(now_s)
            return False
        commanded = lane.graph.publishers(self._commands)
        if now_s - self._since_s[key] < (_IDLE_S if commanded else _IDLE_WITHOUT_COMMANDS_S):
            return False
        lane.judge.find_pollers(now_s)
        lane.judge.find_sleepers()
        return True

    def _rests(self, lane: RosLane) -> bool:
        """Returns whether a lane sleeps: one look in three will do, for a process that polls is awake now and then."""
        for _ in range(3):
            if lane.judge.look(time.perf_counter()) is not Verdict.AWAKE:
                return True
            time.sleep(_PAUSE_S)
            self._pump.serve()
        return False

    def _missing(self, lane: RosLane) -> str:
        """Returns what a lane lacks, for a person; empty if it is complete."""
        unknown = sorted(lane.application.names - lane.graph.nodes())
        if unknown:
            return f"{', '.join(unknown)} did not register with the master"
        unconnected = lane.graph.unconnected()
        if unconnected:
            return "; ".join(unconnected)
        return "its nodes did not come to rest" if lane.graph.busy else ""
