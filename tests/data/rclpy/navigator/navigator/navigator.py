"""Stands for Nav2's bt_navigator: offers NavigateToPose, finds a way on the map, and drives along it."""

import heapq
import itertools
import math
import os

import rclpy
from geometry_msgs.msg import Twist
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future

NEAR_M, WAY_M, SPEED_M_S, TURN_RAD_S = 0.15, 0.12, 0.3, 1.5
# As a costmap of Nav2: no nearer to what is occupied than the hull, if there is another way, and rather this far away.
HULL_M = float(os.environ.get("HULL_M", "0.14"))
WIDE_M = float(os.environ.get("WIDE_M", "0.4"))
GIVES_UP_S = float(os.environ.get("GIVES_UP_S", "inf"))
REJECTS = int(os.environ.get("REJECTS", "0"))
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STEPS = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]


class Navigator(Node):
    def __init__(self):
        super().__init__("bt_navigator")
        self.grid, self.pose, self.way = None, (0.0, 0.0, 0.0), []
        self.driven = self.done = None
        self.rejected = 0
        self.command = self.create_publisher(Twist, "cmd_vel", 10)
        self.costmap = self.create_publisher(OccupancyGrid, "global_costmap/costmap", LATCHED)
        self.create_subscription(OccupancyGrid, "map", self.on_map, LATCHED)
        self.create_subscription(Odometry, "odom", self.on_odometry, 10)
        self.server = ActionServer(
            self,
            NavigateToPose,
            "navigate_to_pose",
            self.navigate,
            goal_callback=self.on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )

    def on_map(self, grid):
        self.grid = grid
        self.costmap.publish(grid)

    def on_goal(self, _):
        self.rejected += 1
        return GoalResponse.REJECT if self.rejected <= REJECTS else GoalResponse.ACCEPT

    def on_odometry(self, odometry):
        turn, where = odometry.pose.pose.orientation, odometry.pose.pose.position
        self.pose = (where.x, where.y, 2.0 * math.atan2(turn.z, turn.w))
        if self.done is None:
            return
        self.now_s = odometry.header.stamp.sec + odometry.header.stamp.nanosec * 1e-9
        self.begun_s = self.now_s if self.begun_s is None else self.begun_s
        if not self.way or self.driven.is_cancel_requested or self.now_s - self.begun_s > GIVES_UP_S:
            self.command.publish(Twist())
            done, self.done = self.done, None
            done.set_result(not self.way)
            return
        self.drive()
        feedback = NavigateToPose.Feedback()
        points = [self.pose[:2], *self.way]
        feedback.distance_remaining = math.fsum(math.dist(*pair) for pair in itertools.pairwise(points))
        self.driven.publish_feedback(feedback)

    def drive(self):
        x, y, yaw = self.pose
        while self.way and math.dist((x, y), self.way[0]) < (WAY_M if len(self.way) > 1 else NEAR_M):
            self.way.pop(0)
        twist = Twist()
        if self.way:
            bearing = math.atan2(self.way[0][1] - y, self.way[0][0] - x) - yaw
            bearing = math.atan2(math.sin(bearing), math.cos(bearing))
            twist.linear.x = SPEED_M_S * max(0.0, math.cos(bearing)) ** 3
            twist.angular.z = max(-TURN_RAD_S, min(TURN_RAD_S, 2.0 * bearing))
        self.command.publish(twist)

    async def navigate(self, handle):
        goal = handle.request.pose.pose.position
        self.way = [(goal.x, goal.y)] if self.grid is None else way_on(self.grid, self.pose[:2], (goal.x, goal.y))
        self.driven, result, self.begun_s = handle, NavigateToPose.Result(), None
        if self.way:
            self.done = Future()
            if await self.done:
                handle.succeed()
                return result
        if handle.is_cancel_requested:
            handle.canceled()
            return result
        result.error_code, result.error_msg = 9999, "gave up"
        handle.abort()
        return result


def way_on(grid, start, goal):
    """Returns points from start to goal over cells that are not occupied; none if there is no way."""
    cell_m, x_m, y_m = grid.info.resolution, grid.info.origin.position.x, grid.info.origin.position.y
    begin, end = ((int((x - x_m) / cell_m), int((y - y_m) / cell_m)) for x, y in (start, goal))
    cells = cells_between(begin, end, costs_of(grid))
    between = [(x_m + (column + 0.5) * cell_m, y_m + (row + 0.5) * cell_m) for column, row in cells[1:-1]]
    return [*between, goal] if cells else []


def costs_of(grid):
    """Returns what a cell, as column and row, costs to cross: the more, the nearer it is to one that is occupied."""
    columns, cell_m = grid.info.width, grid.info.resolution
    cells = {(number % columns, number // columns): value for number, value in enumerate(grid.data)}
    reach = range(-math.ceil(WIDE_M / cell_m), math.ceil(WIDE_M / cell_m) + 1)
    near = [(cell_m * math.hypot(a, b), a, b) for a in reach for b in reach if cell_m * math.hypot(a, b) < WIDE_M]
    costs = {cell: 1.0 for cell, value in cells.items() if not value}
    # Of what is occupied the edge alone is near to anything.
    edge = [(x, y) for (x, y), value in cells.items() if value and any((x + a, y + b) in costs for a, b in STEPS)]
    for x, y in edge:
        for away_m, a, b in near:
            cost = 50.0 if away_m < HULL_M + cell_m / 2 else 1.0 + 3.0 * (1.0 - away_m / WIDE_M)
            if cost > costs.get((x + a, y + b), math.inf):
                costs[x + a, y + b] = cost
    return costs


def cells_between(begin, end, costs):
    """Returns the cheapest way; none if there is no way."""
    totals, before, heap = {begin: 0.0}, {}, [(0.0, begin)]
    while heap:
        total, here = heapq.heappop(heap)
        if here == end:
            break
        if total > totals[here]:
            continue
        for a, b in STEPS:
            there = here[0] + a, here[1] + b
            dearer = total + math.hypot(a, b) * (1.0 if there == end else costs.get(there, math.inf))
            if dearer < totals.get(there, math.inf):
                totals[there], before[there] = dearer, here
                heapq.heappush(heap, (dearer, there))
    if end not in totals:
        return []
    cells = [end]
    while cells[-1] != begin:
        cells.append(before[cells[-1]])
    return cells[::-1]


def main():
    rclpy.init()
    rclpy.spin(Navigator())
