#!/usr/bin/env python3
"""Waits for a message or a service that never comes, and drives a little faster each time that it gave up."""

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Empty

rospy.init_node("gives_up")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
wait = {
    "message": lambda: rospy.wait_for_message("/nothing", Empty, timeout=0.5),
    "service": lambda: rospy.wait_for_service("/nothing", timeout=0.5),
}[rospy.get_param("~kind")]
command = Twist()
while not rospy.is_shutdown():
    try:
        wait()
    except rospy.ROSException:
        command.linear.x += 0.01
        commands.publish(command)
