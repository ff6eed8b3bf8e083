"""Asks who drives to be careful while something is near, by a service."""

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool

NEAR_M = 0.4


class Watch(Node):
    def __init__(self):
        super().__init__("watch")
        self.asked = None
        self.careful = self.create_client(SetBool, "careful")
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)

    def on_scan(self, scan):
        near = min(scan.ranges) < NEAR_M
        if near != self.asked:
            self.asked = near
            self.careful.call_async(SetBool.Request(data=near))


def main():
    rclpy.init()
    rclpy.spin(Watch())
