"""A node that goes as fast as the last advice said when it sees how far it is to the walls, as soon as it can."""

import random
import time

from player import LaserScan, Node, Twist, Vector3

node = Node()
command = node.publisher("/cmd_vel", Twist)
last = [Vector3()]


def on_advice(twist: Twist) -> None:
    last[0] = twist.linear


def on_scan(scan: LaserScan) -> None:
    time.sleep(random.random() * 0.004)  # noqa: S311 - as long as it waits for a core on a busy machine
    command(Twist(last[0], Vector3(z=0.2)))


node.subscribe("/advice", Twist, on_advice)
node.subscribe("/scan", LaserScan, on_scan)
node.spin()
