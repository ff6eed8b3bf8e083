#!/usr/bin/env python3
"""Drives ahead, as fast as SPEED says."""

import os

import rospy
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Clock


def main():
    rospy.init_node("ahead")
    command = Twist()
    command.linear.x = float(os.environ.get("SPEED", "0.4"))
    publisher = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    rospy.Subscriber("/clock", Clock, lambda _: publisher.publish(command), queue_size=1)
    rospy.spin()


main()
