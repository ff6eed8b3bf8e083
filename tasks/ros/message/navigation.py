"""Goals as actions: how an episode's go, and the messages of ROS 1's ``move_base`` (wiki.ros.org/move_base).

An action of ROS 1 is five topics (wiki.ros.org/actionlib/DetailedDescription); of these the robot speaks two.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from tasks.ros.message.ros_messages import read_text, text_bytes

MOVE_BASE = "/move_base/goal"
MOVE_BASE_KIND = "move_base_msgs/MoveBaseActionGoal"
MOVE_BASE_RESULT = "/move_base/result"
MOVE_BASE_RESULT_KIND = "move_base_msgs/MoveBaseActionResult"

GoalStatus = Literal["none", "asked", "accepted", "rejected", "succeeded", "canceled", "aborted"]
# Of actionlib_msgs/GoalStatus: PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED.
_ENDS: Mapping[int, GoalStatus] = {2: "canceled", 3: "succeeded", 4: "aborted", 5: "rejected", 8: "canceled"}
# A header begins with a number and a time, a goal's identity with a time.
_NUMBER_BYTES, _TIME_BYTES = 4, 8


@dataclass
class Navigation:
    """How an episode's goals go.

    Attributes:
        status: Of the goal that was sent last.
        goals: How many were sent.
        error_code: What the result says of why it was aborted.
        fault: Why what a node answered is no answer; empty if there is nothing to say.
        recoveries: How often it recovered, in all goals, as its feedback says; None if that says nothing.
    """

    status: GoalStatus = "none"
    goals: int = 0
    error_code: int = 0
    fault: str = ""
    recoveries: int | None = None
    _earlier: int = 0

    def begin(self) -> None:
        """Notes that the next goal is sent."""
        self.status, self.goals, self._earlier = "asked", self.goals + 1, self.recoveries or 0

    def recovered(self, times: int) -> None:
        """Notes what feedback says of the present goal: how often it recovered so far."""
        self.recoveries = self._earlier + times

    def ask(self, pose: bytes) -> bytes:
        """Returns the next goal, given as a ``PoseStamped``, as a ``move_base_msgs/MoveBaseActionGoal``."""
        self.begin()
        number, time = pose[:_NUMBER_BYTES], pose[_NUMBER_BYTES:][:_TIME_BYTES]
        return number + time + text_bytes("") + time + text_bytes(self._id) + pose

    def hear(self, result: bytes) -> None:
        """Takes a ``move_base_msgs/MoveBaseActionResult``, of whatever goal.

        Raises:
            ValueError: If the bytes are none.
        """
        _, rest = read_text(result[_NUMBER_BYTES + _TIME_BYTES :])
        goal, rest = read_text(rest[_TIME_BYTES:])
        if not rest:
            raise ValueError(f"a result of {len(result)} bytes without a status")
        if goal == self._id and self.status == "asked":
            self.status = _ENDS.get(rest[0], "aborted")

    @property
    def _id(self) -> str:
        """Returns the goal's identity: the same in each repeat."""
        return f"simyard-{self.goals}"
