"""A node that waits on a condition, until its time is over, before it answers a scan."""

import threading

from avoidance import steer
from player import SENSOR_DATA, LaserScan, Node, Twist, Vector3

node = Node()
publish = node.publisher("/cmd_vel", Twist)


def on_scan(scan: LaserScan) -> None:
    ahead, turn = steer(scan.angle_min, scan.angle_increment, scan.ranges)  # type: ignore[arg-type]
    threading.Event().wait(0.03)
    publish(Twist(linear=Vector3(x=ahead), angular=Vector3(z=turn)))


node.subscribe("/scan", LaserScan, on_scan, SENSOR_DATA)
node.spin()
