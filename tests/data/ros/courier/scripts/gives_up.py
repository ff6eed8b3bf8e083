#!/usr/bin/env python3
"""Waits for a message, a service or a result that never comes, and drives a little faster each time that it gave up."""

import rospy
from actionlib import SimpleActionClient
from actionlib.msg import TestAction, TestGoal
from geometry_msgs.msg import Twist
from std_msgs.msg import Empty

rospy.init_node("gives_up")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)


def ask():
    client.send_goal(TestGoal())
    if not client.wait_for_result(rospy.Duration(0.5)):
        raise rospy.ROSException("no result")


client = SimpleActionClient("nobody", TestAction)
wait = {
    "message": lambda: rospy.wait_for_message("/nothing", Empty, timeout=0.5),
    "service": lambda: rospy.wait_for_service("/nothing", timeout=0.5),
    "result": ask,
}[rospy.get_param("~kind")]
command = Twist()
while not rospy.is_shutdown():
    try:
        wait()
    except rospy.ROSException:
        command.linear.x += 0.01
        commands.publish(command)
