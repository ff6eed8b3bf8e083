"""A node that says how fast to go, as soon as it sees how far it is to the walls, or a little later."""

import random
import time

from player import LaserScan, Node, Twist, Vector3

node = Node()
advise = node.publisher("/advice", Twist)


def on_scan(scan: LaserScan) -> None:
    time.sleep(random.random() * 0.004)  # noqa: S311 - as long as it waits for a core on a busy machine
    nearest_m = min(list(scan.ranges))  # type: ignore[call-overload]
    advise(Twist(Vector3(x=nearest_m / 8), Vector3()))


node.subscribe("/scan", LaserScan, on_scan)
node.spin()
