"""A node that offers NavigateToPose as bt_navigator does: drives straight to its goal, or does what PLAYS says."""

import math
import os
from dataclasses import dataclass
from typing import Any

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import final
from player import Header, Node, Odometry, Pose, Time, Twist, Vector3, quality


@final
@dataclass
class UUID(IdlStruct, typename="unique_identifier_msgs.msg.dds_.UUID_"):
    uuid: types.array[types.uint8, 16]


@final
@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
    header: Header
    pose: Pose


@final
@dataclass
class Goal(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_Goal_"):
    pose: PoseStamped
    behavior_tree: str


@final
@dataclass
class Result(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_Result_"):
    error_code: types.uint16
    error_msg: str


@final
@dataclass
class SendRequest(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_SendGoal_Request_"):
    guid: types.uint64
    sequence: types.int64
    goal_id: UUID
    goal: Goal


@final
@dataclass
class SendResponse(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_SendGoal_Response_"):
    guid: types.uint64
    sequence: types.int64
    accepted: bool
    stamp: Time


@final
@dataclass
class ResultRequest(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_GetResult_Request_"):
    guid: types.uint64
    sequence: types.int64
    goal_id: UUID


@final
@dataclass
class ResultResponse(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_GetResult_Response_"):
    guid: types.uint64
    sequence: types.int64
    status: types.int8
    result: Result


@final
@dataclass
class Duration(IdlStruct, typename="builtin_interfaces.msg.dds_.Duration_"):
    sec: types.int32 = 0
    nanosec: types.uint32 = 0


@final
@dataclass
class Feedback(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_Feedback_"):
    current_pose: PoseStamped
    navigation_time: Duration
    estimated_time_remaining: Duration
    number_of_recoveries: types.int16
    distance_remaining: types.float32


@final
@dataclass
class FeedbackMessage(IdlStruct, typename="nav2_msgs.action.dds_.NavigateToPose_FeedbackMessage_"):
    goal_id: UUID
    feedback: Feedback


ACTION = "/navigate_to_pose/_action"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
PLAYS = os.environ.get("PLAYS", "")
RECOVERS_EACH = 8
OTHERS: Any = [255] * 16


class Navigator:
    """Answers what the robot asks."""

    def __init__(self) -> None:
        node = Node()
        self.goal: Pose | None = None
        self.asked: ResultRequest | None = None
        self.seen = self.steps = 0
        self.drive = node.publisher("/cmd_vel", Twist)
        self.answer = node.publisher("", SendResponse, name=f"rr{ACTION}/send_goalReply")
        self.end = node.publisher("", ResultResponse, name=f"rr{ACTION}/get_resultReply")
        self.tell = node.publisher("", FeedbackMessage, name=f"rt{ACTION}/feedback")
        node.subscribe("", SendRequest, self.on_goal, quality(10), name=f"rq{ACTION}/send_goalRequest")
        node.subscribe("", ResultRequest, self.on_asked, quality(10), name=f"rq{ACTION}/get_resultRequest")
        node.subscribe("/odom", Odometry, self.on_odometry)
        node.spin()

    def on_goal(self, request: SendRequest) -> None:
        self.seen += 1
        accepted = PLAYS != "busy" and (PLAYS != "late" or self.seen > 2)
        # Somebody else's answer comes first.
        self.answer(SendResponse(request.guid + 1, request.sequence, not accepted, Time()))
        self.answer(SendResponse(request.guid, request.sequence, accepted, Time()))
        self.goal = request.goal.pose.pose if accepted else None
        self.stamped = request.goal.pose

    def on_asked(self, request: ResultRequest) -> None:
        self.asked = request

    def on_odometry(self, odometry: Odometry) -> None:
        if self.goal is None or self.asked is None:
            return
        self.steps += 1
        where, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        x, y = self.goal.position.x - where.x, self.goal.position.y - where.y
        off = math.atan2(y, x) - 2.0 * math.atan2(turn.z, turn.w)
        there = math.hypot(x, y) < 0.3
        ahead = 0.0 if there else 0.5 * max(0.0, math.cos(off))
        self.drive(Twist(Vector3(ahead), Vector3(z=math.sin(off))))
        # Of somebody else's goal last, as the last word counts.
        for goal_id, recoveries in ((self.asked.goal_id, self.steps // RECOVERS_EACH), (UUID(OTHERS), 99)):
            feedback = Feedback(self.stamped, Duration(), Duration(), recoveries, math.hypot(x, y))
            self.tell(FeedbackMessage(goal_id, feedback))
        if there or (PLAYS and PLAYS != "late" and self.steps == 20):
            status = {"aborts": ABORTED, "cancels": CANCELED}.get(PLAYS, SUCCEEDED)
            code = 9002 if status == ABORTED else 0
            self.end(ResultResponse(self.asked.guid, self.asked.sequence, status, Result(code, "no way")))
            self.goal = None


Navigator()
