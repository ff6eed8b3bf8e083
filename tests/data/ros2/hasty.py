"""A node that commands by the wall's clock, too, in no control step, once it has seen something."""

import threading
import time

from player import SENSOR_DATA, LaserScan, Node, Twist, Vector3

node = Node()
publish = node.publisher("/cmd_vel", Twist)
seen = []


def command() -> None:
    publish(Twist(linear=Vector3(x=0.2), angular=Vector3()))


def hurry() -> None:
    while True:
        time.sleep(0.1)
        command()


def on_scan(scan: LaserScan) -> None:
    seen.append(scan)
    command()
    if len(seen) == 3:
        threading.Thread(target=hurry, daemon=True).start()


node.subscribe("/scan", LaserScan, on_scan, SENSOR_DATA)
node.spin()
