#!/usr/bin/env python3
"""Roams about: ahead where the lidar sees free floor, and away from what it sees near. Knows nothing of Simyard."""

import math

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan

WIDTH_RAD, SIDE_RAD, TURN_RAD_S = 0.7, 1.6, 1.0


class Roam:
    def __init__(self):
        self.speed_m_s = float(rospy.get_param("~speed", 0.2))
        self.near_m = float(rospy.get_param("~near", 0.45))
        self.side = 0
        self.command = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
        rospy.Subscriber("/scan", LaserScan, self.on_scan, queue_size=1)

    def on_scan(self, scan):
        ahead_m, left_m, right_m = free_ways_m(scan)
        twist = Twist()
        if ahead_m < self.near_m:
            self.side = self.side or (1 if left_m > right_m else -1)
            twist.angular.z = TURN_RAD_S * self.side
        else:
            self.side = 0
            twist.linear.x = self.speed_m_s * min(1.0, ahead_m / (2 * self.near_m))
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


if __name__ == "__main__":
    rospy.init_node("roam")
    Roam()
    rospy.spin()
