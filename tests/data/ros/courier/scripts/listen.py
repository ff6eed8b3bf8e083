#!/usr/bin/env python3
"""Asks tf2 where it is each tenth of a second of simulated time, and turns towards a point."""

import math

import rospy
import tf2_ros
from geometry_msgs.msg import Twist

rospy.init_node("listen")
frames = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(frames)
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)


def steer(event):
    if not frames.can_transform("odom", "base_link", rospy.Time(0)):
        return
    found = frames.lookup_transform("odom", "base_link", rospy.Time(0)).transform
    facing = 2.0 * math.atan2(found.rotation.z, found.rotation.w)
    wanted = math.atan2(1.0 - found.translation.y, 2.0 - found.translation.x)
    command = Twist()
    command.linear.x = 0.2
    command.angular.z = math.sin(wanted - facing)
    commands.publish(command)


rospy.Timer(rospy.Duration(0.1), steer)
rospy.spin()
