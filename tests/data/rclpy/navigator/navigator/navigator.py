"""Stands for Nav2's bt_navigator: offers NavigateToPose, finds a way on the map, and drives along it."""

import heapq
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
WIDE_M = float(os.environ.get("WIDE_M", "0.3"))
GIVES_UP_S = float(os.environ.get("GIVES_UP_S", "inf"))
REJECTS = int(os.environ.get("REJECTS", "0"))
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Navigator(Node):
    def __init__(self):
        super().__init__("bt_navigator")
        self.grid, self.pose, self.way, self.done = None, (0.0, 0.0, 0.0), [], None
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
        if not self.way or self.now_s - self.begun_s > GIVES_UP_S:
            self.command.publish(Twist())
            done, self.done = self.done, None
            done.set_result(not self.way)
            return
        self.drive()

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
        result, self.begun_s = NavigateToPose.Result(), None
        if self.way:
            self.done = Future()
            if await self.done:
                handle.succeed()
                return result
        result.error_code, result.error_msg = 9999, "gave up"
        handle.abort()
        return result


def way_on(grid, start, goal):
    """Returns points from start to goal over free cells that are far from others; none if there is no way."""
    cell_m, x_m, y_m = grid.info.resolution, grid.info.origin.position.x, grid.info.origin.position.y
    begin, end = ((int((x - x_m) / cell_m), int((y - y_m) / cell_m)) for x, y in (start, goal))
    cells = cells_between(begin, end, free_cells(grid) | {begin, end})
    between = [(x_m + (column + 0.5) * cell_m, y_m + (row + 0.5) * cell_m) for column, row in cells[1:-1]]
    return [*between, goal] if cells else []


def free_cells(grid):
    """Returns the cells, as column and row, that are far enough from all that is not free."""
    columns, rows, wide = grid.info.width, grid.info.height, WIDE_M / grid.info.resolution
    reach = range(-math.ceil(wide), math.ceil(wide) + 1)
    disc = [(a, b) for a in reach for b in reach if math.hypot(a, b) <= wide]
    blocked = {
        (number % columns + a, number // columns + b)
        for number, value in enumerate(grid.data)
        if value
        for a, b in disc
    }
    return {(column, row) for column in range(columns) for row in range(rows)} - blocked


def cells_between(begin, end, free):
    """Returns the shortest way; none if there is no way."""
    costs, before, heap = {begin: 0.0}, {}, [(0.0, begin)]
    while heap:
        cost, here = heapq.heappop(heap)
        if here == end:
            break
        if cost > costs[here]:
            continue
        for a, b in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]:
            there = here[0] + a, here[1] + b
            total = cost + math.hypot(a, b)
            if there in free and total < costs.get(there, math.inf):
                costs[there], before[there] = total, here
                heapq.heappush(heap, (total, there))
    if end not in costs:
        return []
    cells = [end]
    while cells[-1] != begin:
        cells.append(before[cells[-1]])
    return cells[::-1]


def main():
    rclpy.init()
    rclpy.spin(Navigator())
