#!/usr/bin/env python
"""Answers each scan: ahead while the way is free, else a turn to the freer side, leaning on what odometry says."""

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

rospy.init_node("answer")
speed = rospy.get_param("~speed", 0.4)
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
heading = [0.0]


def hear_odometry(odometry):
    heading[0] = odometry.pose.pose.orientation.z


def hear_scan(scan):
    count = len(scan.ranges)
    middle, half = count // 2, count // 10
    near = min(scan.ranges[middle - half : middle + half])
    right, left = min(scan.ranges[:middle]), min(scan.ranges[middle:])
    command = Twist()
    command.linear.x = speed if near > 0.6 else 0.0
    command.angular.z = 0.2 * heading[0] if near > 0.6 else (0.9 if left > right else -0.9)
    commands.publish(command)


rospy.Subscriber("/odom", Odometry, hear_odometry, queue_size=1)
rospy.Subscriber("/scan", LaserScan, hear_scan, queue_size=1)
rospy.spin()
