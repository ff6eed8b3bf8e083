"""A node that steers ten times a second by the clock of the simulation, by the last scan and the way that it faces."""

import math

from avoidance import steer
from player import SENSOR_DATA, LaserScan, Node, Odometry, Twist, Vector3

node = Node()
publish = node.publisher("/cmd_vel", Twist)
last = {}


def on_odometry(message: Odometry) -> None:
    q = message.pose.pose.orientation
    last["yaw"] = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


def on_timer() -> None:
    if len(last) == 2:
        scan = last["scan"]
        ahead, turn = steer(scan.angle_min, scan.angle_increment, scan.ranges)  # type: ignore[arg-type]
        publish(Twist(linear=Vector3(x=ahead), angular=Vector3(z=turn + 0.1 * math.sin(last["yaw"]))))


node.subscribe("/scan", LaserScan, lambda scan: last.update(scan=scan), SENSOR_DATA)
node.subscribe("/odom", Odometry, on_odometry)
node.timer(100_000_000, on_timer)
node.spin()
