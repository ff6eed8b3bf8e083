"""A node that ends after some scans as if all were well, and without a farewell."""

import os

from player import SENSOR_DATA, LaserScan, Node, Twist, Vector3

node = Node()
publish = node.publisher("/cmd_vel", Twist)
seen = []


def on_scan(scan: LaserScan) -> None:
    seen.append(scan)
    publish(Twist(linear=Vector3(x=0.1), angular=Vector3()))
    if len(seen) == 15:
        os._exit(0)


node.subscribe("/scan", LaserScan, on_scan, SENSOR_DATA)
node.spin()
