"""A node that ends after some scans, with a word."""

import sys

from player import SENSOR_DATA, LaserScan, Node, Twist

node = Node()
publish = node.publisher("/cmd_vel", Twist)
seen = []


def on_scan(scan: LaserScan) -> None:
    seen.append(scan)
    if len(seen) == 15:
        sys.exit("the lidar is on fire")


node.subscribe("/scan", LaserScan, on_scan, SENSOR_DATA)
node.spin()
