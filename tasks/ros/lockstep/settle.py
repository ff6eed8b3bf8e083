"""Sends lanes what is to be sent in a control step, each as fast as its own application comes to rest."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from tasks.ros.lockstep.event_pump import EventPump
from tasks.ros.lockstep.quiet import Verdict
from tasks.ros.lockstep.ros_lane import RosLane

_SOON_S = 0.00003
_FIRST_NAP_S = 0.0001
_NAP_GROWTH = 1.5
_LONGEST_NAP_S = 0.001
_CHECK_S = 0.25


class Patience(NamedTuple):
    """How long an application may take.

    Attributes:
        stage_s: Until it comes to rest after a message; see ``QuietJudge.has_time``.
        late_limit: How often it may not; then it has failed.
    """

    stage_s: float = 2.0
    late_limit: int = 5

    @property
    def nap_s(self) -> float:
        """Returns how long a callback may sleep by the wall's clock."""
        return self.stage_s / 2.0


class Settling:
    """Brings lanes through a control step; none waits for another one before all have come to its end.

    Args:
        pump: Serves their graphs.
        patience: With an application.
        fail: Called with a lane that failed, to end its application at once.
    """

    def __init__(self, pump: EventPump, patience: Patience, fail: Callable[[RosLane], None]) -> None:
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
        verdict = lane.judge.look(now_s)
        if verdict is Verdict.QUIET:
            lane.settle()
        elif verdict is Verdict.STOPPED:
            lane.failure = lane.application.stopped()
        elif lane.judge.has_time(self._patience.stage_s, now_s):
            self._postpone(lane, verdict, now_s)
            return True
        else:
            self._late(lane)
        lane.collect(time_ns)
        if lane.failure:
            self._fail(lane)
            return False
        return lane.send(now_s, fresh=True)

    def _postpone(self, lane: RosLane, verdict: Verdict, now_s: float) -> None:
        if verdict is Verdict.SOON:
            lane.look_s = now_s + _SOON_S
        elif verdict is Verdict.WAITS:
            lane.look_s = max(lane.judge.next_s, now_s + _SOON_S)
        else:
            lane.nap_s = min(max(_FIRST_NAP_S, _NAP_GROWTH * lane.nap_s), _LONGEST_NAP_S)
            lane.look_s = now_s + lane.nap_s

    def _late(self, lane: RosLane) -> None:
        lane.late += 1
        if lane.late >= self._patience.late_limit:
            limit_s = self._patience.stage_s
            lane.failure = f"the application did not come to rest within {limit_s:g} s, {lane.late} times"

    def _check(self, active: Sequence[RosLane], now_s: float) -> None:
        """Looks now and then, while lanes take long, what they use: one that uses too much is ended next."""
        if now_s - self._checked_s < _CHECK_S:
            return
        self._checked_s = now_s
        for lane in active:
            if now_s - lane.begun_s > _CHECK_S:
                lane.failure = lane.failure or lane.application.excess()
                lane.look_s = now_s
