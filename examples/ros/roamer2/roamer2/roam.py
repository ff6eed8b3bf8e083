"""Roams about: ahead where the lidar sees free floor, and away from what it sees near; slowly if it is asked to."""

import math

import rclpy
from geometry_msgs.msg import Twist
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool

WIDTH_RAD, SIDE_RAD, TURN_RAD_S = 0.7, 1.6, 1.0


class Roam(Node):
    def __init__(self):
        super().__init__("roam")
        self.speed_m_s = self.declare_parameter("speed", 0.2).value
        self.near_m = self.declare_parameter("near", 0.45).value
        self.careful, self.side, self.scan = False, 0, None
        self.command = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)
        self.create_service(SetBool, "careful", self.on_careful)
        self.create_timer(0.05, self.on_timer)

    def on_scan(self, scan):
        self.scan = scan

    def on_careful(self, request, response):
        self.careful = request.data
        response.success = True
        return response

    def on_timer(self):
        twist = Twist()
        if self.scan is not None:
            ahead_m, left_m, right_m = free_ways_m(self.scan)
            if ahead_m < self.near_m:
                self.side = self.side or (1 if left_m > right_m else -1)
                twist.angular.z = TURN_RAD_S * self.side
            else:
                self.side = 0
                free = min(1.0, ahead_m / (2 * self.near_m))
                twist.linear.x = self.speed_m_s * free * (0.7 if self.careful else 1.0)
                twist.angular.z = 0.5 * (left_m - right_m) / (left_m + right_m)
        self.command.publish(twist)


def free_ways_m(scan):
    """Returns the nearest that is seen ahead, and what is free on average to the left and to the right."""
    ahead, left, right = [scan.range_max], [scan.range_max], [scan.range_max]
    for number, range_m in enumerate(scan.ranges):
        angle = scan.angle_min + number * scan.angle_increment
        angle = math.atan2(math.sin(angle), math.cos(angle))
        free_m = min(range_m, scan.range_max)  # what sees nothing says inf (REP 117)
        if abs(angle) < WIDTH_RAD:
            ahead.append(free_m)
        if abs(angle) < SIDE_RAD:
            (left if angle > 0 else right).append(free_m)
    return min(ahead), sum(left) / len(left), sum(right) / len(right)


def main():
    rclpy.init()
    rclpy.spin(Roam())
