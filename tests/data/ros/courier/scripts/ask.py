#!/usr/bin/env python3
"""Drives ahead at a rate until a time, then waits for a scan, answers it, and waits for the next one."""

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan

rospy.init_node("ask")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
rate = rospy.Rate(10)
while rospy.get_time() < rospy.get_param("~ahead_until"):
    command = Twist()
    command.linear.x = 0.1
    commands.publish(command)
    rate.sleep()
while not rospy.is_shutdown():
    nearest = min(rospy.wait_for_message("/scan", LaserScan).ranges)
    command = Twist()
    command.linear.x = min(0.3, nearest / 4.0)
    command.angular.z = 0.7 if nearest < 0.5 else 0.05
    commands.publish(command)
