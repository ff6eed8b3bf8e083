"""A node whose tenth command is not a number."""

import math

from player import SENSOR_DATA, LaserScan, Node, Twist, Vector3

node = Node()
publish = node.publisher("/cmd_vel", Twist)
seen = []


def on_scan(scan: LaserScan) -> None:
    seen.append(scan)
    publish(Twist(linear=Vector3(x=math.nan if len(seen) == 10 else 0.2), angular=Vector3()))


node.subscribe("/scan", LaserScan, on_scan, SENSOR_DATA)
node.spin()
