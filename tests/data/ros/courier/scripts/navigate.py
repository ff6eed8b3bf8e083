#!/usr/bin/env python3
"""Stands for move_base: drives to its goals by odometry, or does what PLAYS says; variables have its types."""

import math
import os

import genpy.dynamic
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

GOAL, RESULT = "move_base_msgs/MoveBaseActionGoal", "move_base_msgs/MoveBaseActionResult"
SUCCEEDED, ENDS = 3, {"cancels": 2, "aborts": 4, "rejects": 5}
TYPES = {kind: genpy.dynamic.generate_dynamic(kind, os.environ[kind.split("/")[1]])[kind] for kind in (GOAL, RESULT)}


class Navigator:
    def __init__(self):
        self.goal, self.drives = None, 0
        self.commands = rospy.Publisher("/cmd_vel", Twist, queue_size=10)
        rospy.Subscriber("/odom", Odometry, self.on_odometry, queue_size=10)

    def offer(self):
        self.results = rospy.Publisher("/move_base/result", TYPES[RESULT], queue_size=10)
        rospy.Subscriber("/move_base/goal", TYPES[GOAL], self.on_goal, queue_size=10)

    def on_goal(self, goal):
        self.goal, self.drives = goal, 0
        rospy.logwarn("goal %s", goal.goal_id.id)

    def on_odometry(self, odometry):
        if self.goal is None:
            return
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        goal, twist = self.goal.goal.target_pose.pose.position, Twist()
        bearing = math.atan2(goal.y - place.y, goal.x - place.x) - 2.0 * math.atan2(turn.z, turn.w)
        twist.angular.z = math.atan2(math.sin(bearing), math.cos(bearing))
        twist.linear.x = 0.8 * max(0.0, math.cos(bearing))
        self.drives += 1
        near = math.hypot(goal.x - place.x, goal.y - place.y) < 0.3
        status = SUCCEEDED if near else ENDS.get(os.environ["PLAYS"]) if self.drives == 10 else None
        if status is not None:
            result = TYPES[RESULT]()
            result.status.goal_id, result.status.status, twist = self.goal.goal_id, status, Twist()
            self.results.publish(result)
            self.goal = None
            rospy.logwarn("ended with %s", status)
        self.commands.publish(twist)


rospy.init_node("move_base")
navigator = Navigator()
if os.environ["PLAYS"] == "late":
    rospy.sleep(1.0)
if os.environ["PLAYS"] != "never":
    navigator.offer()
rospy.spin()
