"""Looks, in an episode that runs, whether nodes have begun to poll."""

import time
from collections.abc import Sequence

from tasks.ros.lockstep.event_pump import EventPump
from tasks.ros.lockstep.ros_lane import RosLane

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
        suspect = step == _FIRST_STEP or any(lane.judge.suspect for lane in lanes)
        if step < self._next or not suspect:
            return
        self._next = 2 * step
        begun_s = time.perf_counter()
        lanes = [lane for lane in lanes if not lane.failure]
        for lane in lanes:
            lane.judge.count(begun_s)
        while (left_s := begun_s + _WATCHED_S - time.perf_counter()) > 0.0:
            time.sleep(left_s)
            self._pump.serve()
        for lane in lanes:
            lane.judge.find_pollers(time.perf_counter())
