#!/usr/bin/env python3
"""A loop at a steady rate of simulated time."""

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan

rospy.init_node("steady")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
nearest = [9.0]


def hear(scan):
    nearest[0] = min(scan.ranges)


rospy.Subscriber("/scan", LaserScan, hear, queue_size=1)
rate = rospy.Rate(10)
while not rospy.is_shutdown():
    command = Twist()
    command.linear.x = min(0.3, nearest[0] / 4.0)
    command.angular.z = 0.7 if nearest[0] < 0.5 else 0.05
    commands.publish(command)
    rate.sleep()
