#!/usr/bin/env python3
"""Sleeps before it advertises its commands, as a node that waits for others does; ~clock says by which clock."""

import time

import rospy
from geometry_msgs.msg import Twist

rospy.init_node("late")
{"simulated": rospy.sleep, "wall": time.sleep}[rospy.get_param("~clock")](rospy.get_param("~after"))
commands = rospy.Publisher(rospy.get_param("~topic"), Twist, queue_size=1)
rate, count = rospy.Rate(10), 0
while not rospy.is_shutdown():
    command, count = Twist(), count + 1
    command.linear.x = 0.1 + 0.001 * count
    commands.publish(command)
    rate.sleep()
