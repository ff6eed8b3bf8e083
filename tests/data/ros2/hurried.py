"""A node that commands by the wall's clock, as a wall timer of rclcpp does."""

import threading
import time

from player import Node, Twist, Vector3

node = Node()
publish = node.publisher("/cmd_vel", Twist)


def hurry() -> None:
    while True:
        time.sleep(0.02)
        publish(Twist(linear=Vector3(x=0.2), angular=Vector3()))


threading.Thread(target=hurry, daemon=True).start()
node.spin()
